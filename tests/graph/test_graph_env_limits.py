"""With limits on, the environment over the topics still gives the transitions of the one in process."""

from collections import Counter

import gymnasium
import numpy as np
import pytest
from rled_agent.graph_env import GraphEnv
from rled_msgs_py.processes import Children, program

import rled_sim  # noqa: F401

PATIENCE = 60.0
STEPS = 60
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


@pytest.mark.parametrize("case", CASES)
def test_transitions_are_those_in_process_bit_for_bit_and_nobody_waits(case: str) -> None:
    name, limits = CASES[case]
    options = ["--robot", "planar" if case == "planar" else "panda", "--max-steps", str(STEPS)]
    with Children() as children:
        children.start([*program("rled_sim", "sim_node"), "--discovery-wait", "0.2", *options, *limits])
        over = GraphEnv(timeout=PATIENCE)
        transition = "motors" if case == "motors" else "kinematic"
        inside = gymnasium.make(name, max_steps=STEPS, limits=over.task.limits, transition=transition)
        assert over.task == inside.unwrapped.task
        codes: Counter[str] = Counter()
        for seed in range(4):
            track, expected = drive(over, seed), drive(inside, seed)
            for each in expected:
                each[-1].pop("contacts", None)  # the graph has them on /diagnostics
            assert track == expected
            codes.update(each[-1].get("refused", "none") for each in track)
        over.close()
        inside.close()
        children.check()
    assert codes["none"] > 20
    assert codes.total() - codes["none"] > 20
    assert len(codes) > (1 if case == "motors" else 2)
