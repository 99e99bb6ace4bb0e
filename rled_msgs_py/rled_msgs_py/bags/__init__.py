"""Bags: rosbag2 recordings in MCAP, written and read as records of the contract, without ROS.

``BagWriter`` records, ``Bag`` reads, ``repair`` completes a recording whose process was killed, ``review`` judges one,
``trim``, ``drop``, ``leave_out`` and ``merge`` make new ones.
"""

from rled_msgs_py.bags.bag import Bag
from rled_msgs_py.bags.copies import drop, leave_out, trim
from rled_msgs_py.bags.error import BagError
from rled_msgs_py.bags.merging import merge
from rled_msgs_py.bags.repair import Repaired, repair
from rled_msgs_py.bags.review import Review, review
from rled_msgs_py.bags.tables import JointTable, PoseTable
from rled_msgs_py.bags.writer import BagWriter

__all__ = [
    "Bag",
    "BagError",
    "BagWriter",
    "JointTable",
    "PoseTable",
    "Repaired",
    "Review",
    "drop",
    "leave_out",
    "merge",
    "repair",
    "review",
    "trim",
]
