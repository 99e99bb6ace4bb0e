"""The time at the head of a serialized message."""

import struct

from rled_msgs_py.errors import ContractError
from rled_msgs_py.messages import LATEST, NANOSECONDS
from rled_msgs_py.topics import CLOCK, DIAGNOSTIC_ARRAY, DIAGNOSTICS, JOINT_STATE, POSE_STAMPED

STAMPED = (JOINT_STATE, POSE_STAMPED, DIAGNOSTIC_ARRAY, CLOCK)
"""Types that begin with a builtin_interfaces/Time."""
END = 12


def stamp_of(type_name: str, data: bytes) -> int | None:
    """Stamp (ns) of a serialized message; None when its type has none or it is too short."""
    if type_name not in STAMPED or len(data) < END:
        return None
    seconds, nanoseconds = struct.unpack_from(_time(data), data, 4)
    return int(seconds) * NANOSECONDS + int(nanoseconds)


def sim_stamp(name: str, type_name: str, data: bytes) -> int | None:
    """The same where it is simulation time; on ``/diagnostics`` it is the time of the day."""
    return None if name == DIAGNOSTICS.name else stamp_of(type_name, data)


def moved(name: str, type_name: str, data: bytes, shift: int) -> bytes:
    """The same message with a stamp later by ``shift`` (ns of simulation time); as it is when it has no such stamp.

    Raises:
        ContractError: no message can have the later stamp.
    """
    stamp = sim_stamp(name, type_name, data)
    if stamp is None:
        return data
    if not -LATEST <= stamp + shift < LATEST:
        raise ContractError(
            f"a stamp on {name} of {stamp} ns, to be moved by {shift} ns", f"less than {LATEST} ns then"
        )
    return data[:4] + struct.pack(_time(data), *divmod(stamp + shift, NANOSECONDS)) + data[END:]


def _time(data: bytes) -> str:
    return "<iI" if data[1] & 1 else ">iI"
