"""Updates a second of many seeds in one process, on a CPU or a GPU, beside what the hardware allows.

    python -m tests.bench.population --device cuda --seeds 1 8 32 64 128

prints, for each number of seeds, environment steps with an update each, a second and in all: of the learner as
train_agent runs it, and two bounds: all matrix products of an update alone, and moving what an update has to move.
"""

import argparse
import itertools
import time
from collections.abc import Callable
from typing import NamedTuple

import torch
from rled_agent.methods.td3 import TD3
from rled_agent.training.config import Schedule, TrainConfig
from rled_agent.training.run import Inputs, composed

BATCH, HIDDEN = 100, (400, 300)
OBSERVATION, ACTION = 10, 7


class Rate(NamedTuple):
    """Updates a second, of all seeds.

    Attributes:
        updates: of the learner, with an environment step of each seed.
        products: of the matrix products of an update alone.
        memory: of moving weights, moments and gradients once as Adam and the soft update have to.
    """

    updates: float
    products: float
    memory: float


def rate(seeds: int, device: str, seconds: float = 10.0) -> Rate:
    """Measure plain TD3 on the Panda's task, an update for each environment step."""
    torch.set_num_threads(min(seeds, torch.get_num_threads()))
    torch.set_flush_denormal(True)
    schedule = Schedule(train_after=200, capacity=100_000, batch_size=BATCH, evaluation_episodes=1)
    configs = [TrainConfig(TD3(), seed=seed, schedule=schedule) for seed in range(seeds)]
    with composed(configs, Inputs(), device=device) as population:
        for _ in range(300):
            population.trainer.advance()
        updates = seeds * _per_second(population.trainer.advance, device, seconds)
    products, moved = _products(seeds, device), _moved(seeds, device)
    return Rate(
        updates,
        seeds * _per_second(products, device, seconds / 3.0),
        seeds * _per_second(moved, device, seconds / 3.0),
    )


def _per_second(call: Callable[[], object], device: str, seconds: float) -> float:
    for _ in range(4):
        call()
    _wait(device)
    begun, count = time.perf_counter(), 0
    while time.perf_counter() - begun < seconds:
        for _ in range(10):
            call()
        count += 10
        _wait(device)
    return count / (time.perf_counter() - begun)


def _wait(device: str) -> None:
    if device != "cpu":
        torch.cuda.synchronize()


def _sizes(inputs: int, outputs: int) -> list[tuple[int, int]]:
    widths = (inputs, *HIDDEN, outputs)
    return list(itertools.pairwise(widths))


def _products(seeds: int, device: str) -> Callable[[], None]:
    """Forward: actor and critics, each with its target; backward twice the forward; the actor's every other update."""

    def network(inputs: int, outputs: int, members: int) -> list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]:
        return [
            (
                torch.randn(members, BATCH, a, device=device),
                torch.randn(members, a, b, device=device),
                torch.randn(members, BATCH, b, device=device),
            )
            for a, b in _sizes(inputs, outputs)
        ]

    critics, actor = network(OBSERVATION + ACTION, 1, 2 * seeds), network(OBSERVATION, ACTION, seeds)
    critic, odd = network(OBSERVATION + ACTION, 1, seeds), False

    def forward(layers: list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]) -> None:
        for x, weight, _ in layers:
            torch.bmm(x, weight)

    def backward(layers: list[tuple[torch.Tensor, torch.Tensor, torch.Tensor]], with_weights: bool) -> None:
        for k, (x, weight, error) in enumerate(layers):
            if with_weights:
                torch.bmm(x.transpose(1, 2), error)
            if k or not with_weights:
                torch.bmm(error, weight.transpose(1, 2))

    def update() -> None:
        nonlocal odd
        for layers in (actor, critics, critics):
            forward(layers)
        backward(critics, with_weights=True)
        odd = not odd
        if odd:
            forward(actor)
            forward(critic)
            backward(critic, with_weights=False)
            backward(actor, with_weights=True)

    return update


def _moved(seeds: int, device: str) -> Callable[[], None]:
    """Copies as many bytes as an update reads and writes: of each weight gradient, two moments, weight and target."""

    def weights(inputs: int, outputs: int) -> int:
        return sum((a + 1) * b for a, b in _sizes(inputs, outputs))

    changed = 2 * weights(OBSERVATION + ACTION, 1) + weights(OBSERVATION, ACTION) / 2.0
    # Adam reads four numbers and writes three, a gradient is written, every other update a target is read and written
    numbers = seeds * int(changed * (4 + 3 + 1 + 1.5) / 2.0)
    one, other = (torch.zeros(numbers, device=device) for _ in range(2))
    return lambda: other.copy_(one)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 8])
    parser.add_argument("--seconds", type=float, default=10.0, help="of each measurement")
    options = parser.parse_args()
    print(f"{'seeds':>6}{'updates/s':>14}{'products':>14}{'memory':>14}")
    for seeds in options.seeds:
        found = rate(seeds, options.device, options.seconds)
        print(f"{seeds:>6}{found.updates:>14,.0f}{found.products:>14,.0f}{found.memory:>14,.0f}", flush=True)


if __name__ == "__main__":
    main()
