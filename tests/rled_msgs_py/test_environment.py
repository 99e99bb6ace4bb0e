"""Wherever a command starts: its environment is settled, or what is wrong with it is one line."""

import os
from pathlib import Path

import pytest
from rclpy.context import Context
from rled_msgs_py.environment import (
    require_domain,
    require_middleware,
    require_parameter_files,
    require_range,
    settle_log,
)
from rled_msgs_py.errors import RledError
from rled_msgs_py.ros.node import start_ros


def test_a_domain_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    for given in ["0", "7", "007", "101", ""]:
        monkeypatch.setenv("ROS_DOMAIN_ID", given)
        require_domain()


def test_what_is_no_domain_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    for given in ["102", "abc", "³", "٣", "-1", "+1", "1e1", " 5", "5 ", "5.0", "0x5", "9" * 5000]:
        monkeypatch.setenv("ROS_DOMAIN_ID", given)
        with pytest.raises(RledError, match=r"ROS_DOMAIN_ID is .*; accepted: 0 to 101"):
            require_domain()


def test_a_range_of_discovery_that_ros_does_not_know_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for given in ("", "SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT"):
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", given)
        require_range()
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCAL")
    with pytest.raises(RledError, match=r"'LOCAL'; accepted: SUBNET"):
        require_range()


def test_a_middleware_that_is_not_installed_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    index = tmp_path / "share" / "ament_index" / "resource_index" / "rmw_typesupport"
    index.mkdir(parents=True)
    for name in ("rmw_here_cpp", "rmw_implementation"):
        (index / name).touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    for given in ("", "rmw_here_cpp"):
        monkeypatch.setenv("RMW_IMPLEMENTATION", given)
        require_middleware()
    for given in ("rmw_gone_cpp", "rmw_implementation", "../rmw_here_cpp"):
        monkeypatch.setenv("RMW_IMPLEMENTATION", given)
        with pytest.raises(RledError, match=r"RMW_IMPLEMENTATION is .*rmw_here_cpp"):
            require_middleware()


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """An empty folder for temporary files, and an environment that names no other."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    for name in ("HOME", "ROS_HOME", "ROS_LOG_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


def test_ros_logs_where_it_is_told(
    monkeypatch: pytest.MonkeyPatch, elsewhere: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = {
        "HOME": (str(tmp_path / "new"), "new/.ros/log"),
        "ROS_HOME": (str(tmp_path / "ros"), "ros/log"),
        "ROS_LOG_DIR": ("~/log", "new/log"),
    }
    for name, (value, folder) in told.items():  # each goes before the one above
        monkeypatch.setenv(name, value)
        settle_log()
        assert (tmp_path / folder).is_dir()
        assert os.environ.get("ROS_LOG_DIR") in (None, "~/log")
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "environment",
    [
        {},
        {"HOME": ""},
        {"HOME": "/proc"},
        {"HOME": "/dev/null"},
        {"HOME": "/proc", "ROS_HOME": "~"},
        {"ROS_HOME": "/proc"},
        {"ROS_LOG_DIR": "/proc/log"},
        {"ROS_LOG_DIR": "/dev/full"},
        {"ROS_LOG_DIR": "~/log"},
    ],
    ids=str,
)
def test_a_log_that_cannot_be_written_goes_to_a_temporary_folder_and_this_is_said_once(
    monkeypatch: pytest.MonkeyPatch, elsewhere: Path, capsys: pytest.CaptureFixture[str], environment: dict[str, str]
) -> None:
    monkeypatch.setenv("ROS_LOG_DIR", "")  # so that it is as before after the test
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    settle_log()
    (folder,) = elsewhere.iterdir()
    assert os.environ["ROS_LOG_DIR"] == str(folder)
    assert f"ROS logs to {folder}\n" in capsys.readouterr().err
    settle_log()
    assert capsys.readouterr().err == ""


def test_without_any_folder_to_log_to_the_error_names_the_variable(
    monkeypatch: pytest.MonkeyPatch, elsewhere: Path
) -> None:
    elsewhere.rmdir()
    with pytest.raises(RledError, match=r"nowhere to log to: HOME is not set; .*ROS_LOG_DIR"):
        settle_log()


@pytest.mark.parametrize("content", [b"sim:\n  ros__parameters:\n    robot: \xe4\n", b"a" * (5 << 20), None, "device"])
def test_a_parameter_file_that_is_no_text_is_refused_before_ros_reads_it(
    tmp_path: Path, content: bytes | str | None
) -> None:
    path = Path("/dev/zero") if content == "device" else tmp_path / "params.yaml"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is None:
        os.mkfifo(path)
    with pytest.raises(RledError, match=f"the parameter file {path} is"):
        require_parameter_files(["sim", "--ros-args", "--params-file", str(path)])


def test_what_ros_does_not_take_is_one_line() -> None:
    for arguments in [
        ["-p", "x"],
        ["-p", "robot:=["],
        ["-p", "robot:=\udcff"],
        ["-r", "nonsense"],
        ["-r", "__ns:=a//b"],
        ["--log-level", "loud"],
        ["--unknown"],
        ["--params-file"],
        ["--enclave", "x", "y"],
    ]:
        with pytest.raises(RledError, match=r"ROS does not start: .*") as caught:
            start_ros(["node", "--ros-args", *arguments], Context())
        assert "/src/" not in str(caught.value)


def test_a_parameter_file_that_is_gone_is_an_error_of_the_system(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        start_ros(["node", "--ros-args", "--params-file", str(tmp_path / "gone.yaml")], Context())
