"""Command lines of the nodes, an argument a line, the first tells the node; and what the simulation makes of them."""

import contextlib
import io
from functools import lru_cache
from pathlib import Path

from rled_agent.nodes.agent_params import AgentParams
from rled_msgs_py.params import build, parameters_of, parse_command_line
from rled_sim.robots import robot_named
from rled_sim.sim_params import SimParams, limits_of
from rled_teleop.recording.params import RecordParams
from rled_teleop.web.params import WebParams

from ..mutators.texts import mutate_lines as mutate

__all__ = ["mutate", "read", "seeds"]

NODES = {"sim_node": SimParams, "agent_node": AgentParams, "record_demos": RecordParams, "teleop_web": WebParams}
ZONE = ["--keep-out", "sphere 0.1 0.2 0.3 0.05; box 0 0 0 1 1 1", "--workspace", "-1 -1 -1 1 1 1"]


@lru_cache
def seeds() -> list[bytes]:
    found = [["sim_node", *ZONE, "--velocity-share", "0.5", "--joint-margin", "0.1", "--ros-args", "-p", "seed:=1"]]
    for name, params in NODES.items():
        given = [name]
        for each in parameters_of(params):
            flag = "--" + each.name.replace("_", "-")
            given += [flag] if isinstance(each.default, bool) else [flag, str(each.default)]
        found.append(given)
    return ["\n".join(each).encode() for each in found]


def read(data: bytes, _: Path) -> None:
    program, *arguments = data.decode(errors="surrogateescape").split("\n")
    params = NODES.get(program, SimParams)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            given, _rest = parse_command_line(params, program, "A node.", arguments)
    except SystemExit as end:  # --help
        if end.code:
            raise
        return
    made = build(params, given)
    if isinstance(made, SimParams):
        limits_of(made, robot_named(made.robot))
        made.rules()
