"""Cloning an expert, and what cloning adds to an actor's loss."""

from pathlib import Path

import numpy as np
import pytest
import torch
from rled_agent.data.demonstrations import Moves
from rled_agent.data.opening import open_demonstrations
from rled_agent.data.recorded import Answers, RecordedTrajectories
from rled_agent.learners.actor_losses import Cloning, policy_gradient
from rled_agent.learners.cloning import CloningConfig, CurvePoint, clone_expert
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron, joined
from rled_agent.nn.policy import load_policy
from rled_agent.per_seed import merged
from rled_agent.replay.transitions import Source, Transitions
from rled_msgs_py.errors import RledError

SMALL = Architecture(hidden=(24, 24), activation="leaky_relu")
SHORT = CloningConfig(SMALL, steps=300, validate_every=100, batch_size=64)


def clone(demonstrations, seed=0, config=SHORT):
    points: list[CurvePoint] = []
    policy, curve = clone_expert(demonstrations, config, np.random.default_rng(seed), points.append)
    assert points == curve
    return policy, curve


def test_same_seed_gives_the_same_bytes_of_weights(zeta, tmp_path: Path):
    for name, seed in (("one", 1), ("same", 1), ("other", 2)):
        clone(zeta, seed)[0].save(tmp_path / name)
    one, same, other = ((tmp_path / name).read_bytes() for name in ("one", "same", "other"))
    assert one == same
    assert one != other


@pytest.mark.parametrize("source", ["points", "trajectories"])
def test_the_validation_loss_falls(planar_bag, source):
    _, curve = clone(open_demonstrations(planar_bag, source))
    assert [point.step for point in curve] == [100, 200, 300]
    assert curve[-1].validation < 0.8 * curve[0].validation
    assert curve[-1].train < curve[0].train / 2


def test_the_learning_rate_falls_to_zero_along_a_cosine(zeta, monkeypatch):
    rates: list[float] = []
    monkeypatch.setattr("rled_agent.nn.adam.Adam.step", lambda self, loss, each: rates.extend(each))
    clone(zeta, config=CloningConfig(SMALL, learning_rate=0.01, steps=4, batch_size=8))
    assert rates == pytest.approx([0.01, 0.01 * (0.5 + 0.5**1.5), 0.005, 0.01 * (0.5 - 0.5**1.5)])


def test_the_clone_acts_as_demonstrated(zeta):
    config = CloningConfig(Architecture(hidden=(48, 48), activation="leaky_relu"), steps=1500, validate_every=1500)
    policy, curve = clone(zeta, config=config)
    pairs = zeta.sample(1000, np.random.default_rng(5))
    error = np.square(policy.act(pairs.observations) - pairs.actions) / zeta.task.max_delta**2
    assert error.sum(axis=1).mean() == pytest.approx(curve[-1].validation, rel=0.3)
    assert error.sum(axis=1).mean() < 0.05


def test_the_curve_ends_with_the_last_step(zeta):
    config = CloningConfig(SHORT.architecture, steps=130, validate_every=50, batch_size=8)
    assert [point.step for point in clone(zeta, config=config)[1]] == [50, 100, 130]


def test_the_validation_loss_is_that_of_the_pairs_set_aside(zeta):
    """Worked out again with the generator that the cloning used, draw by draw."""
    policy, curve = clone(zeta, seed=4)
    generator = np.random.default_rng(4)
    rest, aside = zeta.split(0.1, generator)
    rest.sample(50_000, generator)
    generator.integers(2**63)
    pairs = aside.sample(8192, generator)
    error = policy.scaling.normalize_action(policy.act(pairs.observations)) - pairs.actions / 0.1
    assert np.square(error).sum(axis=1).mean() == pytest.approx(curve[-1].validation, rel=1e-4)


def test_a_policy_saved_is_the_policy_learned(zeta, tmp_path: Path):
    policy, _ = clone(zeta)
    policy.save(tmp_path / "expert.safetensors")
    observations = zeta.sample(20, np.random.default_rng(0)).observations
    loaded = load_policy(tmp_path / "expert.safetensors")
    np.testing.assert_array_equal(loaded.act(observations), policy.act(observations))
    assert loaded.task == zeta.task


def answered(task, observations: np.ndarray, trajectory: np.ndarray) -> RecordedTrajectories:
    """States that were answered with nothing, of which it is not known where they led to."""
    nothing = (np.zeros((0, size)) for size in (2, 3, 3, 2, 2, 3, 3))
    unknown = Moves(*nothing, np.zeros(0))
    answers = Answers(observations, np.zeros((len(observations), 2)), trajectory)
    return RecordedTrajectories(task, answers, unknown, np.zeros(0, dtype=np.int64))


def test_too_few_trajectories_are_refused(task):
    one = answered(task, np.zeros((5, 4)), np.zeros(5, dtype=np.int64))
    with pytest.raises(RledError, match="too few demonstrated trajectories"):
        clone(one)


def test_a_loss_that_is_no_number_stops_the_cloning(zeta):
    config = CloningConfig(SHORT.architecture, learning_rate=1.0, steps=200, validate_every=10)
    poisoned = answered(zeta.task, np.full((40, 4), np.nan), np.arange(40, dtype=np.int64))
    with pytest.raises(RledError, match="no number at step 10"):
        clone(poisoned, config=config)


def test_weights_are_drawn_from_the_generator_alone(zeta):
    torch.manual_seed(1)
    one = clone(zeta)[0].network.vector()
    torch.manual_seed(2)
    assert (one == clone(zeta)[0].network.vector()).all()


# Losses of an actor, worked out by hand on three transitions.


ACTION = torch.tensor([[[0.5, 0.0], [0.0, 0.25], [1.0, 1.0]]])
"""Of the actor."""
Q = torch.tensor([[[2.0], [-1.0], [3.0]]])
"""Their values: their mean is 4/3, their mean size 2."""
SHOWN = torch.tensor([[[0.5, 1.0], [0.5, 0.25], [0.0, 1.0]]])
"""Squared distances from the actor's: 1, 1/4 and 1."""


def transitions(*sources: Source) -> Transitions:
    column = torch.tensor([[[float(source)] for source in sources]])
    nothing = torch.zeros(1, 3, 1)
    return Transitions(nothing, SHOWN, nothing, nothing, nothing, column, nothing, torch.zeros(1, 3).long())


def critic() -> Perceptron:
    """Q(s, a) = 2 a₁: 1, 1 and 0 for what was shown, so more than the actor's in the second transition alone."""
    network = Perceptron(3, 1, Architecture(hidden=()), Draws([0]))
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
    assert loss(Cloning(2.0, q_filter=False), A, A, A, q=torch.zeros(1, 3, 1)) == 0.0


def test_the_size_of_values_does_not_change_what_cloning_weighs():
    """Twice the values give the same loss, and the same gradient of the action."""
    gradients = []
    for factor in (1.0, 2.0):
        action = ACTION.clone().requires_grad_()
        q = factor * action.sum(dim=2, keepdim=True)
        value = Cloning(0.5, q_filter=False).loss()(action, q, transitions(D, A, H), critic())
        gradients.append(torch.autograd.grad(value, action)[0])
    torch.testing.assert_close(*gradients)


SEEDS = ((A, A, A), (D, A, A), (A, H, A), (D, D, H))
"""What the transitions of four seeds are."""


@pytest.mark.parametrize("settings", [Cloning(0.5), Cloning(0.5, q_filter=False), Cloning(0.0)], ids=str)
def test_each_seed_has_the_loss_and_the_gradient_that_it_has_alone(settings):
    factors = torch.tensor([1.0, 2.0, 0.5, 0.0]).view(4, 1, 1)
    parts = [transitions(*sources) for sources in SEEDS]
    batch = Transitions(*(torch.cat(columns) for columns in zip(*parts, strict=True)))
    action, q = (ACTION * factors).requires_grad_(), (Q * factors).requires_grad_()
    together = settings.loss()(action, q, batch, joined([critic() for _ in SEEDS]))
    assert together.shape == (4,)
    found = torch.autograd.grad(together.sum(), (action, q), allow_unused=True)
    for k, part in enumerate(parts):
        own_action, own_q = (each.detach()[k : k + 1].requires_grad_() for each in (action, q))
        alone = settings.loss()(own_action, own_q, part, critic())
        assert torch.equal(together[k : k + 1], alone)
        own = torch.autograd.grad(alone.sum(), (own_action, own_q), allow_unused=True)
        for whole, each in zip(found, own, strict=True):
            assert (whole is None and each is None) or torch.equal(whole[k : k + 1], each)


def test_weights_may_differ_between_seeds_and_be_0_for_some():
    batch = Transitions(*(torch.cat([each] * 3) for each in transitions(D, H, A)))
    settings = merged([Cloning(weight, q_filter=False) for weight in (0.5, 0.0, 2.0)])
    found = settings.loss()(ACTION.expand(3, -1, -1), Q.expand(3, -1, -1), batch, joined([critic() for _ in range(3)]))
    cloned = (1.0 + 0.25) / 2
    assert found.tolist() == pytest.approx([-(4 / 3) / 2 + 0.5 * cloned, -4 / 3, -(4 / 3) / 2 + 2.0 * cloned])
