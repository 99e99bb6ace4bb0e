"""Files appear whole or not at all."""

import pytest
from rled_msgs_py.files import whole_file, write_whole


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
