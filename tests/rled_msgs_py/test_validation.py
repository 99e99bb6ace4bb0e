"""Fields are of the kinds and in the bounds that stand beside them, in any dataclass and in parameters of nodes."""

import math
from dataclasses import dataclass, field
from typing import Annotated, Literal

import pytest
from rled_msgs_py.errors import ContractError
from rled_msgs_py.params import build, param, parameters_of, parse_command_line
from rled_msgs_py.validation import Length, Range, check_fields, from_object


@dataclass(frozen=True)
class Inner:
    widths: Annotated[tuple[int, ...], Range(1, 9), Length(3)] = (4,)
    share: Annotated[float, Range(0, 1)] = 0.5


@dataclass(frozen=True)
class Outer:
    inner: Inner = field(default_factory=Inner)
    name: Literal["a", "b"] = "a"
    level: float | None = None
    words: list[str] = field(default_factory=list)
    table: dict[str, int] = field(default_factory=dict)


def test_what_fits_is_taken():
    for values in [
        {}, {"inner": Inner((1, 9, 5), 0)}, {"level": 3}, {"level": -2.5}, {"words": ["x"], "table": {"one": 1}},
        {"inner": Inner(())}, {"name": "b"},
    ]:  # fmt: skip
        check_fields(Outer(**values))


def test_what_does_not_is_refused_by_its_name():
    for values, said in [
        ({"inner": Inner((0,))}, "inner.widths is (0,); accepted: 1 to 9"),
        ({"inner": Inner((1, 10))}, "inner.widths is (1, 10); accepted: 1 to 9"),
        ({"inner": Inner((1,) * 4)}, "inner.widths is (1, 1, 1, 1); accepted: at most 3 values"),
        ({"inner": Inner([4])}, "inner.widths [4]; accepted: a list, each a whole number"),
        ({"inner": Inner((4.0,))}, "inner.widths (4.0,); accepted: a list, each a whole number"),
        ({"inner": Inner((True,))}, "inner.widths (True,); accepted: a list, each a whole number"),
        ({"inner": Inner((4,), 1.5)}, "inner.share is 1.5; accepted: 0 to 1"),
        ({"inner": Inner((4,), math.nan)}, "inner.share nan; accepted: a finite number"),
        ({"inner": Inner((4,), "1")}, "inner.share '1'; accepted: a finite number"),
        ({"inner": None}, "inner None; accepted: an object with widths, share"),
        ({"name": "c"}, "name 'c'; accepted: a, b"),
        ({"name": ["a"]}, "name ['a']; accepted: a, b"),
        ({"level": "high"}, "level 'high'; accepted: a finite number or nothing"),
        ({"level": True}, "level True; accepted: a finite number or nothing"),
        ({"words": ["x", 1]}, "words ['x', 1]; accepted: a list, each a text"),
        ({"table": {"one": "1"}}, "table {'one': '1'}; accepted: a table, each a whole number"),
        ({"table": [1]}, "table [1]; accepted: a table, each a whole number"),
    ]:
        with pytest.raises(ContractError) as caught:
            check_fields(Outer(**values))
        assert str(caught.value) == said


def test_an_error_does_not_repeat_a_large_value():
    with pytest.raises(ContractError) as caught:
        check_fields(Outer(inner=Inner((1,) * 10**6)))
    assert len(str(caught.value)) < 200


def test_an_object_of_json_becomes_a_dataclass_whose_lists_are_tuples_where_it_says_so():
    values = {"inner": {"widths": [1, 2], "share": 1}, "name": "b", "level": None, "words": ["x"], "table": {}}
    assert from_object(Outer, values, "it") == Outer(Inner((1, 2), 1), "b", None, ["x"], {})


# One dataclass of parameters serves the command line.


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
