"""Who acts: noise, policy reuse, the uncertainty gate, proposals, jump starts."""
