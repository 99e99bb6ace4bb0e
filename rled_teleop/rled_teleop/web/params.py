"""Parameters of the page."""

from dataclasses import dataclass

from rled_msgs_py.params import param


@dataclass(frozen=True)
class WebParams:
    """Parameters of the page and of what it starts."""

    host: str = param("127.0.0.1", "address to serve at; beyond this machine only with a token", read_only=True)
    port: int = param(8080, "port to serve at", low=1, high=65535, read_only=True)
    token: str = param("", "word that opens the page; the list of processes shows it to every user", read_only=True)
    token_file: str = param("", "file with that word, which nobody sees; or put it into RLED_TOKEN", read_only=True)
    robot: str = param("", "start a simulation of this robot too; empty: join the graph that runs", read_only=True)
    sim_options: str = param("", 'more options of that simulation, as typed: "--period 0.01"', read_only=True)
    with_agent: str = param("", 'start this agent too, as typed: "agent_node --expert FILE"', read_only=True)
    role: str = param(
        "auto",
        "alone: answer each state; beside: only take over from an agent; auto: by who else is in the graph",
        choices=("auto", "alone", "beside"),
        read_only=True,
    )
    timeout: float = param(
        0.5, "deadman: motion ends so long after the last sign of life of the page (s)", low=0.05, high=2.0,
        read_only=True,
    )  # fmt: skip
    output: str = param("out/web", "folder for the bags that are recorded from the page", read_only=True)
    sim: str = param("sim", "name of the simulation's node", read_only=True)
    agent: str = param("agent_node", "name of the agent's node", read_only=True)
    recorder: str = param("record_demos", "name of the recorder's node", read_only=True)
