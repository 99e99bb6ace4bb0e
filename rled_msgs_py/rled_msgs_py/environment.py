"""What ROS reads from the environment, looked at before ROS is started: a mistake is one line, the log has a place.

It imports no ROS: of an unknown ``RMW_IMPLEMENTATION`` the process would die while it imports rclpy.
"""

import os
import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path

from rled_msgs_py.errors import RledError
from rled_msgs_py.untrusted import read_text

RANGES = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
MAX_DOMAIN = 101


def settle(arguments: Sequence[str], *, with_domain: bool) -> None:
    """Look at all that ROS will read when it is started with ``arguments``, and see to its log.

    Args:
        arguments: program and ``--ros-args ...``.
        with_domain: ``ROS_DOMAIN_ID`` matters.

    Raises:
        RledError: a variable or a parameter file that ROS does not take.
        OSError: a parameter file that cannot be read.
    """
    if with_domain:
        require_domain()
    require_range()
    require_parameter_files(arguments)
    settle_log()


def require_domain() -> None:
    """See that ``ROS_DOMAIN_ID`` is one.

    Raises:
        RledError: it is not.
    """
    domain = os.environ.get("ROS_DOMAIN_ID", "")
    if domain and not (re.fullmatch("[0-9]{1,3}", domain) and int(domain) <= MAX_DOMAIN):
        raise RledError(f"ROS_DOMAIN_ID is '{domain}'", f"0 to {MAX_DOMAIN}", "set another domain id")


def require_range() -> None:
    """See that ``ROS_AUTOMATIC_DISCOVERY_RANGE`` is one: ROS takes any other word for LOCALHOST.

    Raises:
        RledError: it is not.
    """
    given = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "")
    if given and given not in RANGES:
        raise RledError(f"ROS_AUTOMATIC_DISCOVERY_RANGE is '{given}'", ", ".join(RANGES), "set one of these")


def require_middleware() -> None:
    """See that the middleware in ``RMW_IMPLEMENTATION`` is installed.

    Raises:
        RledError: it is not.
    """
    given = os.environ.get("RMW_IMPLEMENTATION", "")
    prefixes = [*filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(":")), sys.prefix]
    indices = [Path(each, "share/ament_index/resource_index/rmw_typesupport") for each in prefixes]
    there = {file.name for index in indices if index.is_dir() for file in index.iterdir()} - {"rmw_implementation"}
    if given and there and given not in there:
        raise RledError(f"RMW_IMPLEMENTATION is '{given}'", ", ".join(sorted(there)), "unset it, or install that one")


def require_parameter_files(arguments: Sequence[str]) -> None:
    """See that each ``--params-file`` is a text that ROS can be given: it would wait for a pipe, and read a device.

    Raises:
        ContractError: it is none.
        OSError: it cannot be read.
    """
    for option, path in pairwise(arguments):
        if option == "--params-file":
            read_text(Path(path), f"the parameter file {path}")


def settle_log() -> None:
    """Have ROS log to a temporary folder, here and in child processes, where the folder it would take is none.

    Raises:
        RledError: there is no temporary folder either.
    """
    folder, problem = _log_folder(), "HOME is not set"
    if folder is not None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                return
        except OSError as error:
            problem = f"{folder} cannot be written to ({error.strerror})"
    try:
        os.environ["ROS_LOG_DIR"] = tempfile.mkdtemp(prefix="ros-log-")
    except OSError:
        what = f"ROS has nowhere to log to: {problem}"
        raise RledError(what, "a folder that can be written to", "name one in ROS_LOG_DIR") from None
    print(f"{problem}: ROS logs to {os.environ['ROS_LOG_DIR']}", file=sys.stderr, flush=True)


def _log_folder() -> Path | None:
    """Where ROS would log to, by its own rules; None where it has no idea."""
    given, ros_home = os.environ.get("ROS_LOG_DIR", ""), os.environ.get("ROS_HOME", "")
    folder, home = given or f"{ros_home or '~/.ros'}/log", os.environ.get("HOME", "")
    if folder.startswith("~"):
        return Path(home + folder[1:]) if home else None
    return Path(folder)


@contextmanager
def held_stderr() -> Iterator[None]:
    """Hold back what C code writes to standard error; drop it where the block fails, whose error says it all."""
    sys.stderr.flush()
    kept, held = os.dup(2), os.memfd_create("held")
    os.dup2(held, 2)
    try:
        yield
        with suppress(OSError):  # nobody reads it
            os.write(kept, os.pread(held, os.fstat(held).st_size, 0))
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(held)
