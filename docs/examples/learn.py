"""From a bag of demonstrations to a policy that is better than its demonstrator, in twenty lines.

Run it in the project's folder: python docs/examples/learn.py [OUTPUT]
"""

import sys
from dataclasses import replace
from pathlib import Path

from rled_agent import PRESETS, CloningConfig, clone, evaluate, open_demonstrations, train

output = Path(sys.argv[1] if len(sys.argv) > 1 else "out/example")
demonstrations = open_demonstrations("bags/planar_shaky", "trajectories")  # thirty motions of a trembling hand
expert = clone(demonstrations, CloningConfig(steps=4_000))
preset = PRESETS["planar_mc_tuned"].config
config = replace(preset, schedule=replace(preset.schedule, steps=6_000))
agent = train(config, demonstrations, expert, output / "run")
agent.save(output / "policy.safetensors")
for name, policy in {"expert": expert, "agent": agent}.items():
    result = evaluate(policy, demonstrations)
    print(f"{name}: {result['targets_reached']:.0%} of the targets, {result['steps']:.1f} steps to each")
