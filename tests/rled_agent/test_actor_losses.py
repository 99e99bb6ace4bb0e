"""Losses of an actor, worked out by hand on three transitions."""

import pytest
import torch
from rled_agent.learners.actor_losses import Cloning, policy_gradient
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.perceptron import Perceptron
from rled_agent.replay.transitions import Source, Transitions

ACTION = torch.tensor([[0.5, 0.0], [0.0, 0.25], [1.0, 1.0]])
"""Of the actor."""
Q = torch.tensor([[2.0], [-1.0], [3.0]])
"""Their values: their mean is 4/3, their mean size 2."""
SHOWN = torch.tensor([[0.5, 1.0], [0.5, 0.25], [0.0, 1.0]])
"""Squared distances from the actor's: 1, 1/4 and 1."""


def transitions(*sources: Source) -> Transitions:
    columns = torch.tensor([[float(source)] for source in sources])
    nothing = torch.zeros(3, 1)
    return Transitions(nothing, SHOWN, nothing, nothing, nothing, columns, nothing, torch.zeros(3).long())


def critic() -> Perceptron:
    """Q(s, a) = 2 a₁: 1, 1 and 0 for what was shown, so more than the actor's in the second transition alone."""
    network = Perceptron(3, 1, Architecture(hidden=()), torch.Generator())
    network.load_vector(torch.tensor([0.0, 2.0, 0.0, 0.0]).numpy())
    return network


def loss(cloning: Cloning, *sources: Source, q: torch.Tensor = Q) -> float:
    return float(cloning.loss()(ACTION, q, transitions(*sources), critic()))


A, E, H, D = Source.AGENT, Source.EXPERT, Source.HUMAN, Source.DEMONSTRATION


def test_the_policy_gradient_raises_the_mean_value():
    assert float(policy_gradient(ACTION, Q, transitions(A, A, A), critic())) == pytest.approx(-4 / 3)


def test_without_weight_nothing_is_cloned_and_values_are_as_they_are():
    assert Cloning(0.0).loss() is policy_gradient


@pytest.mark.parametrize(
    ("sources", "cloned"),
    [
        ((A, E, A), 0.0),  # the expert's actions count as experience
        ((D, A, A), 1.0),
        ((A, H, A), 0.25),
        ((D, H, A), (1.0 + 0.25) / 2),
        ((D, D, H), (1.0 + 0.25 + 1.0) / 3),
    ],
)
def test_what_people_and_demonstrations_show_is_cloned_over_their_number(sources, cloned):
    assert loss(Cloning(0.5, q_filter=False), *sources) == pytest.approx(-(4 / 3) / 2 + 0.5 * cloned)


@pytest.mark.parametrize(("sources", "cloned"), [((D, A, A), 0.0), ((A, D, A), 0.25), ((D, H, D), 0.25 / 3)])
def test_the_filter_leaves_out_what_the_critic_holds_for_no_better(sources, cloned):
    assert loss(Cloning(0.5), *sources) == pytest.approx(-(4 / 3) / 2 + 0.5 * cloned)


def test_values_of_zero_are_not_divided_by():
    assert loss(Cloning(2.0, q_filter=False), A, A, A, q=torch.zeros(3, 1)) == 0.0


def test_the_size_of_values_does_not_change_what_cloning_weighs():
    """Twice the values give the same loss, and the same gradient of the action."""
    gradients = []
    for factor in (1.0, 2.0):
        action = ACTION.clone().requires_grad_()
        q = factor * action.sum(dim=1, keepdim=True)
        value = Cloning(0.5, q_filter=False).loss()(action, q, transitions(D, A, H), critic())
        gradients.append(torch.autograd.grad(value, action)[0])
    torch.testing.assert_close(*gradients)
