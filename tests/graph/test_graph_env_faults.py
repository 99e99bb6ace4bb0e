"""With limits and with faults, the environment over the topics still gives the transitions of the one in process."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any

import gymnasium
import numpy as np
import pytest
from rled_agent.nodes.graph_env import GraphEnv
from rled_msgs_py.processes import Children, program
from rled_sim.faults import NO_FAULTS, Faults

import rled_sim  # noqa: F401

WAIT_TIMEOUT = 60.0
STEPS = 60
FAULTS = {
    "panda": Faults(
        observation_delay=1,
        observation_delay_spread=2,
        reward_delay=2,
        reward_delay_spread=3,
        sensor_noise=0.01,
        observation_loss=0.2,
        hidden="panda_joint2",
    ),
    "planar": Faults(control_delay=1, control_delay_spread=2, actuator_noise=0.2, command_loss=0.2, command_repeat=0.2),
    "lost": Faults(observation_loss=1.0, command_loss=0.9),
}
ZONES = "sphere 0.65 0 0.1 0.15; box 0 -0.5 0 2 0.1 1"
CASES = {
    "panda": ("rled/PandaReach-v0", ["--joint-margin", "0.4", "--workspace", "0.1 -0.3 0.2 0.7 0.3 0.8"]),
    "planar": ("rled/PlanarReach-v0", ["--velocity-share", "0.8", "--acceleration", "200", "--keep-out", ZONES]),
    "motors": ("rled/PandaReach-v0", ["--collisions", "--transition", "motors"]),
}


def drive(env: gymnasium.Env, seed: int) -> list:
    """An episode that goes straight on half of the time, as far as it may."""
    rng, largest = np.random.default_rng(seed), env.action_space.high
    seen = [env.reset(seed=seed)]
    while len(seen) == 1 or not (seen[-1][2] or seen[-1][3]):
        random = rng.uniform(-1.0, 1.0, largest.shape)
        action = largest * (np.sign(seed - 1.5) if rng.uniform() < 0.5 else random)
        seen.append(env.step(action.astype(np.float32)))
    return [(observation.tobytes(), *rest) for observation, *rest in seen]


@contextmanager
def both(name: str, arguments: list[str], **options: Any) -> Iterator[tuple[GraphEnv, gymnasium.Env]]:
    """A task over the graph and in process."""
    robot = "planar" if "Planar" in name else "panda"
    start = [*program("rled_sim", "sim_node"), "--discovery-wait", "0.2", "--robot", robot, "--max-steps", str(STEPS)]
    with Children() as children:
        children.start([*start, *arguments])
        over = GraphEnv(timeout=WAIT_TIMEOUT)
        inside = gymnasium.make(name, max_steps=STEPS, limits=over.task.limits, **options)
        assert over.task == inside.unwrapped.task
        yield over, inside
        over.close()
        inside.close()
        children.check()


@pytest.mark.parametrize("case", CASES)
def test_limited_transitions_are_those_in_process_bit_for_bit_and_nobody_waits(case: str) -> None:
    name, limits = CASES[case]
    codes: Counter[str] = Counter()
    with both(name, limits, transition="motors" if case == "motors" else "kinematic") as (over, inside):
        for seed in range(4):
            expected = drive(inside, seed)
            for each in expected:
                each[-1].pop("contacts", None)  # the graph has them on /diagnostics
            assert drive(over, seed) == expected
            codes.update(each[-1].get("refused", "none") for each in expected)
    assert codes["none"] > 20
    assert codes.total() - codes["none"] > 20
    assert len(codes) > (1 if case == "motors" else 2)


@pytest.mark.parametrize("case", FAULTS)
def test_faulty_transitions_are_those_in_process_bit_for_bit_and_nobody_waits(case: str) -> None:
    faults, name = FAULTS[case], CASES["panda" if case == "panda" else "planar"][0]
    given = {key: value for key, value in asdict(faults).items() if value != getattr(NO_FAULTS, key)}
    arguments = [word for key, value in given.items() for word in ("--" + key.replace("_", "-"), str(value))]
    with both(name, arguments, faults=faults) as (over, inside):
        for seed in (3, 8, 3):
            assert drive(over, seed) == drive(inside, seed)


def test_faults_and_limits_together_end_where_they_do_in_process() -> None:
    faults = Faults(actuator_noise=0.5, control_delay_spread=1, sensor_noise=0.02)
    arguments = ["--actuator-noise", "0.5", "--control-delay-spread", "1", "--sensor-noise", "0.02"]
    with both(CASES["planar"][0], [*arguments, *CASES["planar"][1]], faults=faults) as (over, inside):
        assert drive(over, 1) == drive(inside, 1)
