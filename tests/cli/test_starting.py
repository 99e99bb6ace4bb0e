"""Ctrl-C in the seconds in which a command imports."""

import signal
import subprocess
import sys

import pytest

PATIENCE = 60.0
COMMANDS = {"rled_sim.sim_node": "gymnasium", "rled_teleop.record_demos": "rclpy", "rled_agent.agent_node": "torch"}
"""Commands, and the import in each that takes longest."""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("when", ["numpy.version", "the longest"])
def test_a_command_ends_cleanly_while_it_imports(command: str, when: str, number: signal.Signals) -> None:
    awaited = COMMANDS[command] if when == "the longest" else when
    package, _, module = command.partition(".")
    program = f"from rled_msgs_py.starting import {package}; {package}.{module}()"
    shown = [sys.executable, "-X", "importtime", "-c", program]  # says on stderr what it has imported
    with subprocess.Popen(shown, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        imported = (line.rpartition("|")[2].strip() for line in process.stderr)
        assert awaited in imported
        process.send_signal(number)
        rest = process.stderr.read()
        code = process.wait(timeout=PATIENCE)
    assert "Traceback" not in rest
    assert code == (130 if number == signal.SIGINT else -signal.SIGTERM)
