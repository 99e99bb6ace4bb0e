"""Imports point one way, methods are told apart by their classes alone, and modules are small."""

import ast
import statistics
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from rled_agent.methods import all_methods

import rled_agent

PACKAGE = Path(rled_agent.__file__).parent
FLOORS = [
    {"bounds", "per_seed"},
    {"nn", "replay"},
    {"uncertainty", "data"},
    {"exploration", "rewards", "learners"},
    {"methods"},
    {"training"},
    {"deploy", "experiments", "api"},
    {"nodes"},
    {"cli"},
]
"""From the ground; nothing imports from a floor above its own."""
ASKED_FOR = {"cli.train_agent": {"nodes"}, "cli.train_expert": {"nodes"}}
"""What a command imports only when it is asked to work over the graph."""
ROS = {"rclpy", "std_srvs", "std_msgs", "rcl_interfaces", "sensor_msgs", "geometry_msgs", "diagnostic_msgs"}
MOST_LINES, USUAL_LINES = 300, 120

MODULES = {
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts): path
    for path in sorted(PACKAGE.rglob("*.py"))
    if path.name != "__init__.py"
}


@cache
def tree(name: str) -> ast.Module:
    return ast.parse(MODULES[name].read_text(encoding="utf-8"))


def imported_by(name: str) -> Iterator[str]:
    """Modules, by their full names; ``from package import module`` counts as both."""
    for node in ast.walk(tree(name)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.module, f"{name} imports by dots"
            assert not node.level, f"{name} imports by dots"
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def part_of(name: str) -> str:
    return name.partition(".")[0]


def floor_of(name: str) -> int:
    return next(k for k, floor in enumerate(FLOORS) if part_of(name) in floor)


def own_imports(name: str) -> set[str]:
    """Modules of this package that a module imports, without the package's name."""
    inside = {each.removeprefix("rled_agent.") for each in imported_by(name) if each.startswith("rled_agent.")}
    return {each for each in inside if each in MODULES or any(known.startswith(f"{each}.") for known in MODULES)}


def test_every_public_name_is_there():
    assert sorted(rled_agent.__all__) == sorted(rled_agent._HOMES)
    assert all(getattr(rled_agent, name) is not None for name in rled_agent.__all__)
    with pytest.raises(AttributeError, match="no attribute 'Learner'"):
        rled_agent.Learner  # noqa: B018


def test_every_module_lies_on_a_floor():
    assert {part_of(name) for name in MODULES} <= set.union(*FLOORS)


@pytest.mark.parametrize("name", MODULES)
def test_no_import_runs_up(name):
    allowed = ASKED_FOR.get(name, set())
    for each in own_imports(name):
        assert floor_of(each) <= floor_of(name) or part_of(each) in allowed, f"{name} imports {each}"


def test_what_trains_knows_the_seam_of_methods_and_no_method():
    for name in MODULES:
        if floor_of(name) <= FLOORS.index({"training"}) and part_of(name) != "methods":
            known = {each for each in own_imports(name) if part_of(each) == "methods"}
            assert known <= {"methods.method"}, f"{name} imports {known}"


def test_a_method_is_named_in_no_comparison_outside_the_methods():
    """Their names may be written down, in presets' names or texts, but nothing depends on which one it is."""
    names = set(all_methods())
    for module in MODULES:
        if part_of(module) == "methods":
            continue
        for node in ast.walk(tree(module)):
            compared: list[ast.expr] = []
            if isinstance(node, ast.Compare):
                compared = [node.left, *node.comparators]
            elif isinstance(node, ast.MatchValue):
                compared = [node.value]
            constants = {each.value for part in compared for each in ast.walk(part) if isinstance(each, ast.Constant)}
            assert not names & constants, f"{module}, line {node.lineno}: {names & constants}"


def test_no_class_of_a_method_is_asked_for_outside_the_methods():
    classes = {method.__name__ for method in all_methods().values()}
    for module in MODULES:
        for node in ast.walk(tree(module)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "isinstance":
                asked = {each.id for each in ast.walk(node.args[1]) if isinstance(each, ast.Name)}
                assert not classes & asked, f"{module}, line {node.lineno}: {classes & asked}"


def test_every_module_but_the_nodes_imports_without_ros_and_pybullet():
    """The commands too: train_agent needs ROS only to train over the graph, and pybullet only to open a robot."""
    modules = [f"rled_agent.{name}" for name in MODULES if part_of(name) != "nodes"] + ["rled_msgs_py.bags"]
    program = f"""
import sys
sys.modules.update(rclpy=None, pybullet=None)
import {", ".join(modules)}
foreign = {{name.partition(".")[0] for name in sys.modules}} & {ROS - {"rclpy"}!r}
assert not foreign, foreign
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_ros_is_imported_by_nodes_alone():
    for name in MODULES:
        assert part_of(name) == "nodes" or not ROS & {part_of(each) for each in imported_by(name)}, name


def test_nothing_imports_pybullet_or_the_world():
    for name, path in MODULES.items():
        assert "pybullet" not in {part_of(each) for each in imported_by(name)}, name
        assert "rled_sim.bullet" not in path.read_text(), name


def test_no_module_loads_a_pickle():
    for name, path in MODULES.items():
        assert not {"pickle", "shelve", "dill", "joblib"} & {part_of(each) for each in imported_by(name)}, name
        assert "torch.load" not in path.read_text(), name


def test_modules_are_small():
    lines = {name: len(path.read_text(encoding="utf-8").splitlines()) for name, path in MODULES.items()}
    assert {name for name, count in lines.items() if count > MOST_LINES} == set()
    assert statistics.median(lines.values()) <= USUAL_LINES
