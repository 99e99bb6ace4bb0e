"""How sure a policy is of its action: from dropped units or from an ensemble, by several measures."""
