"""From a bag of demonstrations to a policy, in twenty lines.

Run it in the project's folder: python docs/examples/learn.py [OUTPUT]
"""

import sys
from dataclasses import replace
from pathlib import Path

import torch

from rled_agent import PRESETS, CloningConfig, clone, evaluate, open_demonstrations, train

torch.set_num_threads(1)  # the networks are small
output = Path(sys.argv[1] if len(sys.argv) > 1 else "out/example")
demonstrations = open_demonstrations("bags/planar_lemniscate")
expert = clone(demonstrations, CloningConfig(steps=1_000))
preset = PRESETS["planar_mc_tuned"].config
config = replace(preset, schedule=replace(preset.schedule, steps=3_000))
agent = train(config, demonstrations, expert, output / "run")
agent.save(output / "policy.safetensors")
for name, policy in {"expert": expert, "agent": agent}.items():
    result = evaluate(policy, demonstrations)
    print(f"{name}: {result['targets_reached']:.0%} of the targets, {result['steps']:.1f} steps to each")
