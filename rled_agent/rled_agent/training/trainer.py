"""The training loop of a population: the same for environments in this process and for one over the graph."""

from typing import NamedTuple

import torch
from rled_msgs_py.errors import RledError
from torch import Tensor

from rled_agent.exploration.strategy import Choice, Strategy, is_anywhere, network_function
from rled_agent.methods.method import Learning
from rled_agent.nn.scaling import Scaling
from rled_agent.per_seed import column
from rled_agent.replay.transitions import Source, Step
from rled_agent.training.checkpoint import Checkpoint
from rled_agent.training.config import Schedule
from rled_agent.training.environment_batch import EnvironmentBatch, EnvironmentStep
from rled_agent.training.evaluating import Evaluator, units_of
from rled_agent.training.learning_state import (
    learning_state,
    pack,
    part_of,
    require_layout,
    restore_learning,
    restoring,
    seed_of,
    together,
    whole_number,
)
from rled_agent.training.metrics import MetricsAccumulator


class DivergenceError(RledError):
    """A loss that is no number."""


class Environments(NamedTuple):
    """Where a population learns.

    Attributes:
        training: to act in, one for each seed.
        evaluation: others of the same kind, to be looked at in: one for each seed, or one for each of its episodes.
        scaling: of observations and actions.
    """

    training: EnvironmentBatch
    evaluation: EnvironmentBatch
    scaling: Scaling


class Trainer:
    """P runs that take their steps together: environments, what learns, who acts, and counters.

    No seed knows of the others: each has the numbers that it would have alone.

    Args:
        environments: where they learn.
        learning: learner, replay and batches; its draws have the seeds.
        strategy: who acts.
        schedule: when to do what.
        has_expert: whether an expert might act.

    Attributes:
        step: environment steps of each.
        diverged: whether a loss of a seed was no number, shape (P,); what it does from then on means nothing.
    """

    def __init__(
        self,
        environments: Environments,
        learning: Learning,
        strategy: Strategy,
        schedule: Schedule,
        has_expert: bool,
    ) -> None:
        self.env, self.scaling = environments.training, environments.scaling
        self.learning, self.strategy, self.schedule, self.has_expert = learning, strategy, schedule, has_expert
        self.step, self.act, self.metrics = 0, network_function(learning.learner.actor), MetricsAccumulator()
        draws = learning.learner.draws
        self._device = draws.device
        self._units = units_of(self.scaling, draws.device)
        episodes = schedule.evaluation_episodes
        self.evaluate_function = Evaluator(environments.evaluation, episodes, self._units, draws.population)
        self.diverged = torch.zeros(draws.population, dtype=torch.bool, device=draws.device)
        self.env.seed(draws.seeds)
        self._begin()

    @property
    def seeds(self) -> int:
        """P."""
        return len(self.diverged)

    def _begin(self) -> None:
        """An episode begins for each seed."""
        self._begins = torch.ones_like(self.diverged)
        self._return = torch.zeros(self.seeds, dtype=torch.float64, device=self._device)
        self._length = torch.zeros_like(self._return)
        self._observation = self._units.normalised(self.env.begin(self._begins))

    def advance(self) -> None:
        """One environment step of each seed, and while it is on its way the gradient steps that are due."""
        self.strategy.begin(self._begins)
        choice = self.strategy.act(self._observation)
        action = torch.nan_to_num(self._units.physical(choice.action))  # of a seed that has diverged
        self.env.announce(action)
        schedule = self.schedule
        if self.step and self.step >= schedule.train_after and self.step % schedule.train_every == 0:
            self._learn(schedule.gradient_steps)
        self._take(choice, self.env.step(action))
        self.step += 1

    def _take(self, choice: Choice, step: EnvironmentStep) -> None:
        """Keep a step, and begin the episodes that follow those that it ended."""
        over = step.terminated | step.truncated
        following = self._units.normalised(step.observation)
        goes_on = (~step.terminated).float()
        discount = goes_on * column(self.learning.gamma, goes_on)
        source = torch.where(choice.by_expert, float(Source.EXPERT), float(Source.AGENT))
        reward = step.reward.float()
        self.learning.replay.add(Step(self._observation, choice.action, reward, discount, following, source, over))
        self._return, self._length = self._return + step.reward, self._length + 1.0
        self.metrics.count(choice, step, self._return, self._length)
        self.strategy.end(over, self._return)
        self._begins, self._observation = over, following
        if is_anywhere(over):
            self._return, self._length = (torch.where(over, 0.0, each) for each in (self._return, self._length))
            self._observation = self._units.normalised(self.env.begin(over))

    def _learn(self, gradient_steps: int) -> None:
        for _ in range(gradient_steps):
            update = self.learning.update(self.schedule.batch_size)
            self.metrics.updates.append(update)
        if gradient_steps:
            self.diverged = self.diverged | ~torch.isfinite(update.td_error.sum(dim=1))
            if self._device.type == "cpu" and self.diverged.all():
                raise DivergenceError(f"a loss is no number at step {self.step}", "", "lower the learning rates")

    def evaluate(self) -> list[dict[str, float]]:
        """Mean result of each actor without noise or dropout, on the same episodes every time."""
        return self.evaluate_function(self.act)

    def checkpoints(self) -> list[Checkpoint]:
        """All state of each seed, as of a run of its own."""
        whole = pack(**learning_state(self.learning), strategy=self.strategy.state_dict(), run=self._run_state())
        states = self.env.states()
        return [
            seed_of(whole, k, self.seeds).joined(pack(environment=state)) for k, state in enumerate(states)
        ]  # fmt: skip

    def _run_state(self) -> dict[str, Tensor | int]:
        tensors = {"begins": self._begins, "return": self._return, "length": self._length}
        return tensors | {"step": self.step, "drawn": self.learning.learner.draws.taken}

    def restore(self, checkpoints: list[Checkpoint]) -> bool:
        """Go on: bit for bit where the environments can be brought to where they were, else with new episodes.

        Returns:
            Whether the episodes go on where they were.

        Raises:
            TensorFileError: of another configuration or environment, of several steps, or not as ``checkpoints`` made
                them.
        """
        with restoring("the checkpoint"):
            whole = together([each.without("environment") for each in checkpoints])
            restore_learning(whole, self.learning)
            strategy, run = part_of(whole, "strategy", may_lack=True), part_of(whole, "run")
            require_layout(strategy, self.strategy.state_dict(), "the state of who acts")
            self.strategy.load_state_dict(strategy)
            self.step = whole_number(run, "step")
            self.learning.learner.draws.taken = whole_number(run, "drawn")
            repeats = self.env.restore([part_of(each, "environment") for each in checkpoints])
            if repeats:
                self._begins = run["begins"].bool()
                self._return, self._length = (run[name].to(self._return) for name in ("return", "length"))
                self._observation = self._units.normalised(self.env.begin(torch.zeros_like(self._begins)))
        if not repeats:
            self.learning.replay.cut()
            self._begin()
        return repeats
