"""TD3 and DDPG: the update against a second writing of it, and targets worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from rled_agent.learners.td3 import BatchPolicy, TD3Config, TD3Learner
from rled_agent.nn.architecture import Architecture
from rled_agent.nn.draws import Draws
from rled_agent.nn.perceptron import Perceptron
from rled_agent.replay.transitions import Transitions
from rled_msgs_py.errors import RledError
from torch import Tensor
from torch.nn import functional

from .td3_cases import CASES, ROWS, SMALL, TD3, Case, batches, make, transitions


class Reference:
    """The update written with autograd and torch.optim, weight by weight as in the papers."""

    def __init__(self, learner: TD3Learner, case: Case, draws: Draws) -> None:
        self.config, self.cloning, self.draws, self.k = case.config, case.cloning, draws, 0
        nets = learner.networks()
        self.weights = {name: self.parts(nets[name]) for name in nets}
        for name in ("actor", "critic"):
            for each in self.weights[name].values():
                each.requires_grad_()
        self.actor_adam = torch.optim.Adam(self.weights["actor"].values())
        self.critic_adam = torch.optim.Adam(self.weights["critic"].values())

    @staticmethod
    def parts(network: Perceptron) -> dict[str, Tensor]:
        return {name: each.clone() for name, each in network.state_dict().items()}

    def net(self, name: str, x: Tensor, member: int = 0, dropping: bool = False) -> Tensor:
        settings = self.config.actor if "actor" in name else self.config.critic
        masks = self.masks(len(x), settings) if dropping and settings.dropout else []
        for k in range(len(settings.hidden) + 1):
            weights = self.weights[name]
            x = functional.linear(x, weights[f"weights.{k}"][member].T, weights[f"biases.{k}"][member, 0])
            if k < len(settings.hidden):
                x = functional.relu(x)
                if masks:
                    x = x * masks[k]
        return x

    def masks(self, rows: int, settings: Architecture) -> list[Tensor]:
        sizes = [rows * width for width in settings.hidden]
        factors = self.draws.kept(settings.dropout, sum(sizes))[0].to(self.weights["actor"]["weights.0"]).split(sizes)
        return [each.view(rows, width) for each, width in zip(factors, settings.hidden, strict=True)]

    def act(self, name: str, s: Tensor, dropping: bool) -> Tensor:
        return torch.tanh(self.net(name, s, dropping=dropping))

    def target(self, batch: Transitions) -> Tensor:
        config = self.config
        with torch.no_grad():
            a = self.act("target_actor", batch.next_observation, config.target_dropout)
            noise = config.target_noise * self.draws.normal(*a.shape)[0].to(a)
            a = torch.clamp(a + torch.clamp(noise, -config.target_clip, config.target_clip), -1, 1)
            x = torch.cat([batch.next_observation, a], dim=1)
            q = torch.stack([self.net("target_critic", x, member) for member in range(config.critics)])
            lesser, reward = q.min(dim=0).values, config.reward_scale * batch.reward
            return reward + batch.discount * lesser

    def step(self, adam: torch.optim.Adam, loss: Tensor, rate: float) -> None:
        for group in adam.param_groups:
            group["lr"] = rate / (1 + self.k / self.config.rate_decay) if self.config.rate_decay else rate
        adam.zero_grad()
        loss.backward()
        adam.step()

    def update(self, batch: Transitions) -> None:
        """Of the rows of a single seed, (b, ...)."""
        config, y = self.config, self.target(batch)
        x = torch.cat([batch.observation, batch.action], dim=1)
        errors = [
            (batch.weight * (self.net("critic", x, member) - y).square()).mean() for member in range(config.critics)
        ]
        self.step(self.critic_adam, sum(errors), config.critic_rate)
        if (self.k + 1) % config.delay == 0:
            self.step(self.actor_adam, self.actor_loss(batch), config.actor_rate)
            self.soften()
        self.k += 1

    def actor_loss(self, batch: Transitions) -> Tensor:
        a = self.act("actor", batch.observation, dropping=True)
        q = self.net("critic", torch.cat([batch.observation, a], dim=1))
        weight, d = self.cloning.weight, int(batch.demonstrated.sum())
        if not weight:
            return -q.mean()
        loss = -q.mean() / q.abs().mean().detach()
        if d:
            s, demonstrated = batch.observation[-d:], batch.action[-d:]
            error = (a[-d:] - demonstrated).square().sum(dim=1)
            if self.cloning.q_filter:
                better = self.net("critic", torch.cat([s, demonstrated], dim=1)) > q[-d:]
                error = error * better[:, 0].detach()
            loss = loss + weight * error.mean()
        return loss

    def soften(self) -> None:
        tau = self.config.tau
        with torch.no_grad():
            for name in ("actor", "critic"):
                for key, target in self.weights[f"target_{name}"].items():
                    target.copy_(tau * self.weights[name][key] + (1 - tau) * target)


@pytest.mark.usefixtures("double")
@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_updates_equal_those_of_the_second_writing(case):
    learner = make(case.config, 3, actor_loss=case.cloning.loss())
    reference = Reference(learner, case, Draws([3]))
    reference.draws.taken = learner.draws.taken
    for batch in batches(12, case.demonstrated):
        if case.weighted:
            batch = batch._replace(weight=torch.linspace(0.1, 1.0, ROWS)[None, :, None])
        learner.update(batch)
        reference.update(Transitions(*(each[0] for each in batch)))
    for name, network in learner.networks().items():
        for key, parameter in network.state_dict().items():
            expected = reference.weights[name][key].detach()
            torch.testing.assert_close(parameter, expected, rtol=1e-9, atol=1e-11, msg=f"{name}.{key}")
    assert learner.draws.taken == reference.draws.taken


def linear(critics: int = 2, proposal: BatchPolicy | None = None, **settings: object) -> TD3Learner:
    """Actor tanh(w s + b) and critics w s + v a + b, of one observation and one action; the online critics stay 0."""
    flat = Architecture(hidden=())
    config = TD3Config(**{"critics": critics, "target_noise": 0.0, "critic_rate": 0.0, "tau": 0.0} | settings)
    learner = TD3Learner(1, 1, replace(config, actor=flat, critic=flat), Draws([0]), proposal=proposal)
    for network in learner.networks().values():
        network.load_vector(0.0 * network.vector())
    return learner


def set_target(learner: TD3Learner, actor: tuple[float, float], *critics: tuple[float, float, float]) -> None:
    """Weights (w, b) of the target actor, and (w, v, b) of each target critic."""
    parts = learner.target_actor.state_dict()
    parts["weights.0"].fill_(actor[0])
    parts["biases.0"].fill_(actor[1])
    parts = learner.target_critic.state_dict()
    for member, (w, v, b) in enumerate(critics):
        parts["weights.0"][member] = torch.tensor([[w], [v]])
        parts["biases.0"][member] = b


def y(learner: TD3Learner, reward: float, terminated: bool, following: float, gamma: float | None = None) -> float:
    """The target of one transition: the online critics say 0, so it is their error, the sign less."""
    discount = (learner.config.gamma if gamma is None else gamma) * (1.0 - terminated)
    parts = (torch.tensor([[[each]]]) for each in (0.0, 0.0, reward, discount, following))
    return -float(learner.update(transitions(*parts)).td_error)


def test_target_takes_the_lesser_of_the_two_critics():
    learner = linear(gamma=0.5)
    set_target(learner, (0.0, 0.0), (2.0, 0.0, 1.0), (-1.0, 0.0, 10.0))
    # s' = 1: Q' = 3 and 9; s' = 4: Q' = 9 and 6
    assert y(learner, 5.0, False, 1.0) == pytest.approx(5.0 + 0.5 * 3.0)
    assert y(learner, 5.0, False, 4.0) == pytest.approx(5.0 + 0.5 * 6.0)


def test_target_with_one_critic_takes_it():
    learner = linear(critics=1, gamma=0.5)
    set_target(learner, (0.0, 0.0), (2.0, 0.0, 1.0))
    assert y(learner, 5.0, False, 4.0) == pytest.approx(5.0 + 0.5 * 9.0)


def test_target_values_the_action_of_the_target_actor():
    learner = linear(gamma=1.0)
    set_target(learner, (1.0, 0.25), (0.0, 10.0, 0.0), (0.0, 10.0, 5.0))
    assert y(learner, 5.0, False, 0.5) == pytest.approx(5.0 + 10.0 * 0.6351489523872873)  # tanh(0.75)


def test_the_experts_action_counts_where_the_target_critics_prefer_it():
    learner = linear(gamma=1.0, proposal=lambda following: 0.5 * following)
    set_target(learner, (0.0, 0.25), (0.0, 10.0, 0.0), (0.0, 10.0, 0.0))
    own = 10.0 * 0.24491866240370913  # tanh(0.25)
    assert y(learner, 5.0, False, 0.4) == pytest.approx(5.0 + own)  # the expert's 0.2 is worth 2
    assert y(learner, 5.0, False, 0.8) == pytest.approx(5.0 + 4.0)
    assert y(learner, 5.0, True, 0.8) == pytest.approx(5.0)


def test_a_pair_is_worth_what_the_lesser_target_critic_says():
    learner = linear()
    set_target(learner, (0.0, 0.0), (2.0, 3.0, 1.0), (-1.0, 4.0, 1.5))
    value = learner.value(torch.tensor([[[0.5]]]), torch.tensor([[[-1.0]]]))
    assert value.shape == (1, 1, 1)
    assert float(value) == pytest.approx(min(2.0 * 0.5 - 3.0 + 1.0, -0.5 - 4.0 + 1.5))


def test_no_value_follows_a_terminated_transition():
    learner = linear()
    set_target(learner, (0.0, 0.0), (0.0, 0.0, 100.0), (0.0, 0.0, 100.0))
    assert y(learner, 7.0, True, 1.0) == pytest.approx(7.0)
    assert y(learner, 7.0, False, 1.0) == pytest.approx(7.0 + 0.99 * 100.0)


def test_smoothing_noise_is_clipped():
    learner = linear(gamma=1.0, target_noise=10.0, target_clip=0.005)
    set_target(learner, (0.0, 0.0), (0.0, 400.0, 0.0), (0.0, -400.0, 0.0))
    # a' = 0 plus or minus 0.005: the lesser of 400 a' and -400 a' is -2
    assert [y(learner, 5.0, False, 0.0) for _ in range(10)] == pytest.approx([3.0] * 10)


def test_smoothed_actions_stay_within_their_bounds():
    learner = linear(gamma=1.0, target_noise=10.0, target_clip=0.005)
    set_target(learner, (0.0, 100.0), (0.0, 400.0, -396.0), (0.0, 400.0, -396.0))
    # a' = 1 plus or minus 0.005, clipped to 1: 400 a' - 396 is 4 or 2
    seen = {round(y(learner, 5.0, False, 0.0), 3) for _ in range(40)}
    assert seen == {7.0, 9.0}


def test_smoothing_noise_has_its_deviation():
    learner = linear(gamma=1.0, target_noise=0.1, target_clip=10.0)
    set_target(learner, (0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0))
    nothing = torch.zeros(1, 2000, 1)
    update = learner.update(transitions(nothing, nothing, nothing + 5.0, nothing + 1.0, nothing))
    noise = -update.td_error - 5.0
    assert abs(float(noise.mean())) < 0.01
    assert float(noise.std()) == pytest.approx(0.1, rel=0.1)


@pytest.mark.parametrize("target_dropout", [False, True])
def test_target_actor_drops_units_only_where_the_settings_say_so(target_dropout):
    dropping = Architecture(hidden=(64,), dropout=0.5)
    config = replace(TD3, actor=dropping, target_noise=0.0, target_dropout=target_dropout, delay=1000, critic_rate=0.0)
    learner, (batch,) = make(config), batches(1)
    losses = {float(learner.update(batch).metrics["critic_loss"].mean()) for _ in range(5)}
    assert len(losses) == (5 if target_dropout else 1)


def test_actor_and_targets_wait_for_the_delay():
    learner = make(replace(TD3, delay=3))

    def weights() -> dict[str, Tensor]:
        return {name: torch.from_numpy(network.vector()) for name, network in learner.networks().items()}

    before = weights()
    for batch in batches(2):
        learner.update(batch)
    waiting = {name for name, each in weights().items() if torch.equal(each, before[name])}
    assert waiting == {"actor", "target_actor", "target_critic"}
    learner.update(batches(1)[0])
    assert not any(torch.equal(each, before[name]) for name, each in weights().items())


def test_targets_move_the_share_tau_of_the_way():
    learner = linear(delay=1, tau=0.25, actor_rate=0.0)
    learner.actor.load_vector(np.full(2, 4.0, np.float32))
    learner.critic.load_vector(np.full(6, -8.0, np.float32))
    learner.update(transitions(*torch.zeros(5, 1, 3, 1)))
    assert (learner.target_actor.vector() == 1.0).all()
    assert (learner.target_critic.vector() == -2.0).all()


def test_targets_begin_as_copies():
    learner = make(TD3)
    assert (learner.actor.vector() == learner.target_actor.vector()).all()
    assert (learner.critic.vector() == learner.target_critic.vector()).all()
    assert learner.actor.weights[0].data_ptr() != learner.target_actor.weights[0].data_ptr()


def test_twin_critics_begin_apart():
    weight = make(TD3).critic.weights[0]
    assert not torch.equal(weight[0], weight[1])


def test_the_value_after_several_steps_counts_as_the_transition_says():
    learner = linear(gamma=0.5)
    set_target(learner, (0.0, 0.0), (2.0, 0.0, 1.0), (2.0, 0.0, 1.0))
    assert y(learner, 5.0, False, 1.0, gamma=0.125) == pytest.approx(5.0 + 0.125 * 3.0)


def test_metrics_and_errors_are_those_before_the_step():
    learner, (batch,) = make(TD3), batches(1, gamma=0.0)
    q = learner.critic(torch.cat([batch.observation, batch.action], dim=2)).detach()  # (2, b, 1)
    td_error, metrics = learner.update(batch)
    assert set(metrics) == {"critic_loss", "q"}
    assert float(metrics["q"].mean()) == pytest.approx(float(q.mean()), rel=1e-4)
    assert float(metrics["critic_loss"].mean()) == pytest.approx(float((q - batch.reward).square().mean()), rel=1e-5)
    torch.testing.assert_close(td_error, (q - batch.reward).mean(dim=0)[None, :, 0])  # of the two critics
    assert not any(each.requires_grad for each in (td_error, *metrics.values()))


def test_same_seed_gives_the_same_updates():
    dropping = replace(TD3, actor=replace(SMALL, dropout=0.2))
    learners = [make(dropping, 2) for _ in range(2)]
    for learner in learners:
        for batch in batches(5):
            learner.update(batch)
    assert_same(*learners)


def assert_same(one: TD3Learner, other: TD3Learner) -> None:
    left, right = one.state_dict(), other.state_dict()
    assert left.keys() == right.keys()
    for count in ("updates", "actor_updates"):
        assert left.pop(count) == right.pop(count)
    assert all(torch.equal(left[name], right[name]) for name in left)


def test_its_state_and_the_place_in_its_draws_are_all_there_is():
    one, other = (make(replace(TD3, rate_decay=3.0), 1, 5) for _ in range(2))
    other.start_from(make(TD3, 8, 9).actor)
    for batch in batches(3, seeds=2):
        one.update(batch)
    other.load_state_dict(one.state_dict())
    assert other.updates == 3
    other.draws.taken = one.draws.taken
    for learner in (one, other):
        for batch in batches(4, seeds=2):
            learner.update(batch)
    assert_same(one, other)


def test_the_state_of_other_networks_is_refused_and_nothing_changed():
    learner = make(TD3)
    before = learner.actor.vector()
    wider = replace(TD3, critic=Architecture(hidden=(6, 9)))
    with pytest.raises(RledError, match=r"it holds \(2, 4, 6\) as actor\.weights\.0; accepted: \(1, 4, 6\)"):
        learner.load_state_dict(make(TD3, 0, 1).state_dict())
    for other in (replace(TD3, critics=1), wider):
        with pytest.raises(RledError, match=r"it holds \(.*\) as critic\.weights\.\d; accepted: \("):
            learner.load_state_dict(make(other, 1).state_dict())
    state = make(TD3, 1).state_dict()
    del state["critic_adam.weights.0.exp_avg"]
    with pytest.raises(RledError, match=r"it holds nothing as critic_adam\.weights\.0\.exp_avg"):
        learner.load_state_dict(state)
    assert (learner.actor.vector() == before).all()


def test_learning_finds_the_best_action_of_a_bandit():
    settings = Architecture(hidden=(32, 32))
    config = TD3Config(gamma=0.0, actor_rate=3e-3, critic_rate=3e-3, actor=settings, critic=settings)
    learner, drawing = TD3Learner(1, 1, config, Draws([0, 1])), torch.Generator().manual_seed(1)
    best = torch.tensor([0.4, -0.3]).view(2, 1, 1)
    for _ in range(400):
        a = torch.rand(2, 64, 1, generator=drawing) * 2 - 1
        nothing = torch.zeros(2, 64, 1)
        learner.update(transitions(nothing, a, -(a - best).square(), nothing, nothing))
    assert learner.actor(torch.zeros(1, 1)).view(-1).tolist() == pytest.approx([0.4, -0.3], abs=0.1)
