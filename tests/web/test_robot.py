import pytest
from rled_sim.robots import ROBOTS
from rled_teleop.web.robot import load_robot

LINK = "<robot name='r'><link name='a'>{}</link></robot>"
TEXTS = {
    "nothing": "",
    "no XML": "{}",
    "no name": "<robot><link name='a'/></robot>",
    "a joint without links": "<robot name='r'><link name='a'/><joint name='j' type='fixed'/></robot>",
    "an empty geometry": LINK.format("<visual><geometry/></visual>"),
    "a mesh without a file": LINK.format("<visual><geometry><mesh/></geometry></visual>"),
    "a colour beyond white": LINK.format(
        "<visual><geometry><box size='1 1 1'/></geometry><material name='m'><color rgba='2 2 2 1'/></material></visual>"
    ),
}


def test_a_description_that_cannot_be_drawn_is_one_kind_of_error():
    for text in TEXTS.values():
        with pytest.raises(ValueError, match=r"the robot description cannot be drawn \(\w+: "):
            load_robot(text)


def test_our_robots_are_drawn():
    for robot in ROBOTS.values():
        assert not load_robot(robot.description).missing
