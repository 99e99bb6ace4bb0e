"""One dataclass of parameters serves the command line."""

from dataclasses import dataclass

import pytest
from rled_msgs_py.errors import ContractError
from rled_msgs_py.params import build, param, parameters_of, parse_command_line


@dataclass(frozen=True)
class Params:
    robot: str = param("panda", "the robot", choices=("panda", "planar"))
    rate: float = param(50.0, "ticks a second", low=1.0, high=1000.0)
    joint_count: int = param(7, "joints, 100% of them", low=1, high=9)
    gui: bool = param(False, "show a window")
    output: str = param("", "a folder", read_only=True)


def parse(*argv):
    return parse_command_line(Params, "sim_node", "Simulates.", argv)


def test_what_is_left_out_is_not_given():
    assert parse() == ({}, [])


def test_values_have_the_type_of_their_default():
    given, _ = parse("--robot", "planar", "--rate", "25", "--joint-count", "2", "--gui", "--output", "out")
    assert given == {"robot": "planar", "rate": 25.0, "joint_count": 2, "gui": True, "output": "out"}
    assert isinstance(given["rate"], float)
    assert build(Params, given) == Params("planar", 25.0, 2, True, "out")


def test_a_flag_can_be_denied():
    assert parse("--no-gui") == ({"gui": False}, [])


def test_arguments_for_ros_are_left_to_ros():
    ros = ["--ros-args", "-p", "rate:=5.0", "--rate", "7"]
    assert parse("--rate", "25", *ros) == ({"rate": 25.0}, ros)


def test_a_bad_command_line_is_one_error_naming_the_option():
    for argv, offender in [
        (["--rate", "0.5"], "rate is 0.5; accepted: 1.0 to 1000.0"),
        (["--rate", "nan"], "rate is nan; accepted: 1.0 to 1000.0"),
        (["--joint-count", "10"], "joint_count is 10; accepted: 1 to 9"),
        (["--robot", "hexapod"], "robot is 'hexapod'; accepted: panda, planar"),
        (["--rate", "fast"], "rate.*'fast'"),
        (["--joint-count", "2.5"], "joint-count.*'2.5'"),
        (["--rate"], "rate"),
        (["--colour", "red"], "--colour"),
        (["--rob", "planar"], "--rob"),
        (["planar"], "planar"),
    ]:
        with pytest.raises(ContractError, match=offender):
            parse(*argv)


def test_help_shows_every_parameter_with_its_default(capsys):
    with pytest.raises(SystemExit) as exit_:
        parse("--help")
    assert exit_.value.code == 0
    text = capsys.readouterr().out
    for each in parameters_of(Params):
        assert "--" + each.name.replace("_", "-") in text
    assert "100% of them (default: 7)" in " ".join(text.split())


def test_a_value_from_elsewhere_is_checked_too():
    with pytest.raises(ContractError, match="rate is 0"):
        build(Params, {"rate": 0.0})
    assert build(Params, {}) == Params()
