"""Memory of large messages goes back to the system when they are gone.

Fast DDS keeps the memory of the largest message that a reader ever had, once for each place in its queue, and malloc
keeps for itself what is freed once it was asked for some megabytes. A few messages of a stranger would then be paid for
as long as the node lives.
"""

import ctypes
import os
from pathlib import Path

PROFILES = Path(__file__).with_name("fastdds.xml")
OWN = ("RMW_FASTRTPS_USE_QOS_FROM_XML", "FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
"""Set by a user who has profiles of Fast DDS; they stay as they are."""
M_MMAP_THRESHOLD = -3
LARGE = 256 << 10
"""Bytes of a block that malloc takes from the system and gives back by itself."""


def return_messages() -> None:
    """Let Fast DDS free what it does not need; call it before ``rclpy.init``."""
    if not any(name in os.environ for name in OWN):
        os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(PROFILES)
        os.environ["RMW_FASTRTPS_USE_QOS_FROM_XML"] = "1"


def return_blocks() -> None:
    """Let malloc return large blocks at once, for a process that is a node and nothing else."""
    ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, LARGE)
