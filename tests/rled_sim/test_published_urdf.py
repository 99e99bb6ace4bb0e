"""What is published of a robot is enough for any tool to draw it: its meshes, its frames and all of its joints."""

import os
import runpy
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pybullet
import pytest
import yourdfpy
from rled_sim.bullet.world import World
from rled_sim.kinematics import Chain
from rled_sim.published_urdf import mesh_path, publishable
from rled_sim.robot_description import main
from rled_sim.robots import ROBOTS, Robot
from scipy.spatial.transform import Rotation

PACKAGE = Path(__file__).parents[2] / "rled_sim"
EVERY = pytest.mark.parametrize("robot", ROBOTS.values(), ids=lambda robot: robot.name)


@pytest.fixture(scope="session")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package's share as it is installed, put together from what ``setup.py`` says."""
    folder, said = tmp_path_factory.mktemp("prefix"), dict[str, Any]()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("setuptools.setup", said.update)
        runpy.run_path(str(PACKAGE / "setup.py"))
    for place, files in said["data_files"]:
        (folder / place).mkdir(parents=True, exist_ok=True)
        for file in files:
            (folder / place / Path(file).name).symlink_to(PACKAGE / file)
    return folder


def meshes_of(description: str) -> list[str]:
    return [each.attrib["filename"] for each in ElementTree.fromstring(description).iter("mesh")]


def loaded(description: str, prefix: Path) -> yourdfpy.URDF:
    """As a tool reads it that knows nothing but the text and where packages are."""

    def find(fname: str) -> str:
        package, _, path = fname.removeprefix("package://").partition("/")
        return str(prefix / "share" / package / path)

    file = prefix / "robot.urdf"
    file.write_text(description)
    return yourdfpy.URDF.load(str(file), filename_handler=find, build_scene_graph=True, load_meshes=True)


@EVERY
def test_every_mesh_is_where_the_package_is_installed(robot: Robot, prefix: Path) -> None:
    for mesh in meshes_of(robot.description):
        assert mesh.startswith("package://rled_sim/")
        assert (prefix / "share" / mesh.removeprefix("package://")).is_file()
    shapes = loaded(robot.description, prefix).scene.geometry
    visuals = ElementTree.fromstring(robot.description).findall("link/visual")
    assert len(shapes) >= len(visuals) > 0


@EVERY
def test_all_hangs_on_world_and_every_joint_that_moves_is_in_joint_states(robot: Robot, prefix: Path) -> None:
    urdf = loaded(robot.description, prefix)
    assert urdf.base_link == "world"
    assert tuple(urdf.actuated_joint_names) == robot.joint_names
    assert not any(joint.mimic for joint in urdf.robot.joints)


@EVERY
def test_the_frames_are_those_of_the_simulation_with_what_is_held(robot: Robot, prefix: Path) -> None:
    urdf, world = loaded(robot.description, prefix), World(robot, "kinematic", 0.02)
    body, client = world._body.number, world._client.number
    links = {pybullet.getJointInfo(body, k, client)[12].decode(): k for k in range(_joints(world))}
    generator = np.random.default_rng(0)
    for _ in range(5):
        q = generator.uniform(robot.lower, robot.upper)
        world.place(q.tolist())
        urdf.update_cfg(dict(zip(robot.joint_names, q, strict=True)))
        for link, index in links.items():
            state = pybullet.getLinkState(body, index, 0, 1, client)
            frame = urdf.get_transform(link, "world")
            np.testing.assert_allclose(frame[:3, 3], state[4], atol=1e-5)
            turned = Rotation.from_matrix(frame[:3, :3]) * Rotation.from_quat(state[5]).inv()
            assert turned.magnitude() < 1e-5, link
        tip = urdf.get_transform(robot.tip_link, "world")[:3, 3]
        np.testing.assert_allclose(tip, world.position, atol=1e-5)  # what ee_pose says
        np.testing.assert_allclose(tip, robot.chain.position(q), atol=1e-9)
    world.close()


def _joints(world: World) -> int:
    return int(pybullet.getNumJoints(world._body.number, world._client.number))


@EVERY
def test_kinematics_are_the_same_to_the_bit(robot: Robot) -> None:
    original = Chain.from_urdf(robot.urdf.read_text(), robot.tip_link, robot.joint_names)
    q = np.random.default_rng(1).uniform(robot.lower, robot.upper, (500, len(robot.lower)))
    assert np.array_equal(robot.chain.position(q), original.position(q))


@EVERY
def test_the_text_names_no_place_on_this_machine(robot: Robot) -> None:
    assert str(robot.urdf.parent) not in robot.description
    assert "file:" not in robot.description


HELD = """<robot name="r">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/>
  <joint name="moved" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="turned" type="continuous"><parent link="a"/><child link="b"/><axis xyz="{axis}"/>
    <origin xyz="1 2 3" rpy="0.3 0.2 0.1"/><dynamics damping="1"/></joint>
  <joint name="slid" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="0 2 0"/>
    <origin rpy="0 0 1.5707963267948966"/><limit lower="0" upper="1" velocity="1" effort="1"/>
    <mimic joint="moved"/></joint>
</robot>"""


@pytest.mark.parametrize("axis", ["1 0 0", "0 1 0", "0 0 1", "-1 2 0.5"])
@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi / 2, -2.5])
def test_a_joint_is_fixed_where_it_is_held(tmp_path: Path, axis: str, angle: float) -> None:
    file = tmp_path / "r.urdf"
    file.write_text(HELD.format(axis=axis))
    text = publishable(file, ("moved",), {"turned": angle, "slid": 0.25})
    before = yourdfpy.URDF.load(str(file), build_scene_graph=True)
    before.update_cfg({"moved": 0.4, "turned": angle})
    published = loaded(text, tmp_path)
    published.update_cfg({"moved": 0.4})
    np.testing.assert_allclose(published.get_transform("b", "world"), before.get_transform("b", "base"), atol=1e-9)
    slid = published.get_transform("c", "b")
    np.testing.assert_allclose(slid[:3, 3], [-0.25, 0.0, 0.0], atol=1e-9)  # a unit axis y, turned by 90 degrees


def test_a_robot_that_stands_on_world_already_is_left_so(tmp_path: Path) -> None:
    file = tmp_path / "r.urdf"
    file.write_text(HELD.format(axis="1 0 0").replace('"base"', '"world"'))
    text = publishable(file, ("moved", "turned", "slid"), {})
    assert text.count('name="world"') == 1
    assert loaded(text, tmp_path).base_link == "world"


def test_a_mesh_of_another_package_keeps_its_name(tmp_path: Path) -> None:
    file = tmp_path / "r.urdf"
    mesh = '<visual><geometry><mesh filename="{}"/></geometry></visual>'
    names = ["package://other/a.stl", "file:///a.stl", "mine.stl", "package://mine.stl", "gone.stl"]
    file.write_text(f'<robot name="r"><link name="l">{"".join(map(mesh.format, names))}</link></robot>')
    (tmp_path / "mine.stl").touch()
    own = f"package://rled_sim/robots/{tmp_path.name}/mine.stl"
    assert meshes_of(publishable(file, (), {})) == [*names[:2], own, own, "gone.stl"]


def test_a_mesh_is_found_in_a_workspace_first_and_beside_its_robot_without_one(
    monkeypatch: pytest.MonkeyPatch, prefix: Path
) -> None:
    robot = ROBOTS["panda"]
    name, old = meshes_of(robot.description)[0], "package://meshes/collision/link0.obj"
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    for each in (name, old):
        assert mesh_path(each, [robot.urdf.parent]) == robot.urdf.parent / "meshes" / "collision" / "link0.obj"
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere{os.pathsep}{prefix}")
    assert mesh_path(name, [robot.urdf.parent]).is_relative_to(prefix)
    assert mesh_path("package://other/a.stl", [robot.urdf.parent]) == Path("other/a.stl")
    assert mesh_path("file:///a.stl", []) == Path("/a.stl")


@EVERY
def test_the_command_prints_what_the_simulation_publishes(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["robot_description", robot.name])
    main()
    assert capsys.readouterr().out == robot.description


def test_the_command_names_the_robots_that_there_are(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["robot_description", "nobody"])
    with pytest.raises(SystemExit):
        main()
    assert capsys.readouterr().err.startswith("error: unknown robot 'nobody'; accepted: panda, planar")
