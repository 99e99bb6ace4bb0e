"""Files appear whole or not at all; where they can't go is said before the work, with a remedy that helps."""

import os
import stat
from pathlib import Path

import pytest
from rled_msgs_py.errors import RledError
from rled_msgs_py.files import whole_file, write_whole
from rled_msgs_py.outputs import require_output

SAID = "name another folder with --output"


@pytest.mark.parametrize("name", ["new", "new/below/it", "there", "a name with spaces", "."])
def test_a_folder_that_is_there_or_can_be_made_is_taken_and_not_made(tmp_path, name):
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "curve.csv").touch()
    require_output(tmp_path / name, "curve.csv", "summary.json")
    assert {each.name for each in tmp_path.rglob("*")} == {"there", "curve.csv"}


def test_a_relative_folder_is_looked_at_from_here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    require_output(Path("out/run"))
    (tmp_path / "out").touch()
    with pytest.raises(RledError, match=f"^out is no folder; accepted: a folder for the results; {SAID}$"):
        require_output(Path("out/run"))


@pytest.mark.parametrize("below", ["", "run", "run/more"])
@pytest.mark.parametrize("kind", ["file", "pipe", "link to nothing", "link to a file"])
def test_what_is_no_folder_is_named(tmp_path, below, kind):
    path = tmp_path / "out"
    if kind == "file":
        path.touch()
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        (tmp_path / "file").touch()
        path.symlink_to("nothing" if kind == "link to nothing" else "file")
    with pytest.raises(RledError, match=f"^{path} is no folder; accepted: a folder for the results; {SAID}$"):
        require_output(path / below)


def test_a_folder_in_the_place_of_a_file_is_named(tmp_path):
    (tmp_path / "summary.json").mkdir()
    with pytest.raises(RledError, match=r"summary.json is a folder; accepted: a file, or nothing"):
        require_output(tmp_path, "curve.csv", "summary.json")


def test_what_cannot_be_written_into_is_one_line():
    for folder in ["/proc/1/out", "/sys/out", "/dev/null/out", "x" * 300, "out/" + "y" * 5000]:
        with pytest.raises(RledError, match=SAID) as caught:
            require_output(Path(folder))
        assert "\n" not in str(caught.value)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_named(tmp_path):
    tmp_path.chmod(stat.S_IREAD | stat.S_IEXEC)
    with pytest.raises(RledError, match=rf"can't write into {tmp_path}/run \(Permission denied\)"):
        require_output(tmp_path / "run")


def test_the_remedy_is_the_command_s_own(tmp_path):
    (tmp_path / "runs").touch()
    with pytest.raises(RledError, match=r"; name another with --runs$"):
        require_output(tmp_path / "runs", remedy="name another with --runs")


# Files appear whole or not at all.


def test_text_is_written_where_no_folder_was(tmp_path):
    write_whole(tmp_path / "a" / "b.json", "{}")
    assert (tmp_path / "a" / "b.json").read_text() == "{}"
    assert len(list((tmp_path / "a").iterdir())) == 1


def test_a_failure_keeps_the_old_file_and_leaves_nothing_else(tmp_path):
    path = tmp_path / "a.txt"
    write_whole(path, "old")
    with pytest.raises(ZeroDivisionError), whole_file(path) as temporary:
        temporary.write_text(f"ne{1 // 0}")
    assert [each.name for each in tmp_path.iterdir()] == ["a.txt"]
    assert path.read_text() == "old"


def test_nobody_sees_a_part_of_the_file(tmp_path):
    path = tmp_path / "a.npz"
    with whole_file(path) as temporary:
        assert temporary.suffix == ".npz"
        temporary.write_bytes(b"12")
        assert not path.exists()
    assert path.read_bytes() == b"12"
