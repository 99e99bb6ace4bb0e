"""A bag that somebody writes is replaced, removed or repaired by nobody else."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from rled_msgs_py.bags import Bag, BagError, BagWriter, drop, merge, repair, trim
from rled_msgs_py.bags.error import BagInUse, remedy
from rled_msgs_py.bags.metadata import FILE_NAME
from rled_msgs_py.files import whole_file
from rosbags.rosbag2 import CompressionMode

from .samples import recording, tick, write_bag
from .test_bag_peers import assert_recording, write_with_rosbags


def silent(_):
    pass


COPIES = {
    "trim": lambda bag, output: trim(bag, output, 0.0, 1.0, silent, overwrite=True),
    "drop": lambda bag, output: drop(bag, output, [0], silent, overwrite=True),
    "merge": lambda bag, output: merge([bag, bag], output, silent, overwrite=True),
}


def files(path):
    return {each.name: each.read_bytes() for each in path.iterdir()}


@pytest.fixture
def source(tmp_path):
    return Bag(write_bag(tmp_path / "source", ticks=20))


@pytest.mark.parametrize("copy", COPIES.values(), ids=COPIES.keys())
def test_nobody_takes_the_place_of_a_bag_under_recording(tmp_path, source, copy):
    path = tmp_path / "bag"
    with BagWriter(path) as writer:
        for topic, record in recording(20):
            writer.write(topic, record)
        writer.flush()
        before = files(path)
        for call in (lambda: BagWriter(path, overwrite=True), lambda: copy(source, path), lambda: repair(path)):
            with pytest.raises(BagInUse, match=r"bag_0\.mcap is being recorded; .*; end the recorder first"):
                call()
        assert files(path) == before
    assert sorted(each.name for each in tmp_path.iterdir()) == ["bag", "source"]
    assert_recording(Bag(path), ticks=20)
    copy(source, path)  # nobody writes it any more
    assert Bag(path).task == source.task


def test_a_recorder_holds_its_bag_until_the_metadata_are_written(tmp_path, monkeypatch):
    refusals = []

    def overwritten_meanwhile(*arguments):
        with pytest.raises(BagInUse) as error:
            BagWriter(tmp_path / "bag", overwrite=True)
        refusals.append(error)
        monkeypatch.undo()
        write(*arguments)

    from rled_msgs_py.bags import writer

    write = writer.write_metadata
    monkeypatch.setattr(writer, "write_metadata", overwritten_meanwhile)
    write_bag(tmp_path / "bag", ticks=20)
    assert len(refusals) == 1
    assert Bag(tmp_path / "bag").message_count == 102


@pytest.mark.parametrize("overwrite", [False, True])
def test_of_recorders_that_start_together_one_records(tmp_path, overwrite):
    for attempt in range(30):
        path, writers, errors = tmp_path / str(attempt) / "bag", [], []
        write_bag(path, ticks=1) if overwrite else None
        together = threading.Barrier(8)

        def begin(path=path, writers=writers, errors=errors, together=together):
            together.wait()
            try:
                writers.append(BagWriter(path, overwrite=overwrite))
            except BagError as error:
                errors.append(error)

        threads = [threading.Thread(target=begin) for _ in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(writers) == 1
        assert len(writers) + len(errors) == 8
        for writer in writers:
            writer.write(*tick(0)[0])
            writer.close()
            assert Bag(path).message_count == 1


def test_a_killed_recorder_holds_nothing(tmp_path):
    program = """
import os, sys
from pathlib import Path
from tests.rled_msgs_py.samples import recording
from rled_msgs_py.bags import BagWriter
writer = BagWriter(Path(sys.argv[1]))
for topic, record in recording(3):
    writer.write(topic, record)
writer.flush()
os.kill(os.getpid(), 9)
"""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", program, str(tmp_path / "bag")], env=environment, check=False)
    assert repair(tmp_path / "bag").messages == 17
    BagWriter(tmp_path / "bag", overwrite=True).close()


@pytest.mark.parametrize("copy", COPIES.values(), ids=COPIES.keys())
@pytest.mark.parametrize("place", ["folder", "file", "another way"])
def test_a_copy_does_not_take_the_place_of_what_it_is_made_of(tmp_path, source, copy, place):
    before = files(source.path)
    bag = Bag(source.path / "source_0.mcap") if place == "file" else source
    output = tmp_path / "x" / ".." / "source" if place == "another way" else source.path
    (tmp_path / "x").mkdir()
    with pytest.raises(BagError, match=r"is the bag that is read; .*; choose another name"):
        copy(bag, output)
    assert files(source.path) == before


def test_what_cannot_be_put_in_place_leaves_what_was_there(tmp_path, source, monkeypatch):
    path = write_bag(tmp_path / "bag", ticks=3)
    before, rename = files(path), Path.rename

    def failing(self, target):
        if target == path and files(self) != before:  # the copy, not what is put back
            raise OSError(28, "No space left on device")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(BagError, match="bag cannot be made: No space left on device"):
        trim(source, path, 0.0, 1.0, silent, overwrite=True)
    assert files(path) == before
    assert sorted(each.name for each in tmp_path.iterdir()) == ["bag", "source"]


def test_a_full_disk_under_a_copy_names_the_output_and_not_its_temporary_folder(tmp_path, source, monkeypatch):
    from rled_msgs_py.bags.mcap_output import Output

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Output, "write", full)
    with pytest.raises(BagError) as error:
        trim(source, tmp_path / "out", 0.0, 1.0, silent)
    assert (
        str(error.value)
        == f"writing {tmp_path / 'out'} failed: No space left on device; nothing has changed; free space"
    )
    (tmp_path / "source" / FILE_NAME).unlink()
    file = tmp_path / "source" / "source_0.mcap"
    file.write_bytes(file.read_bytes()[:-100])
    with pytest.raises(BagError) as error:
        repair(tmp_path / "source")
    assert str(error.value) == f"{file} cannot be repaired: No space left on device; it is as it was"


def test_what_killed_processes_have_left_may_be_overwritten(tmp_path):
    path = write_bag(tmp_path / "bag", ticks=3)
    (path / ".bag_0.mcap.new-abcdefgh").mkdir()
    (path / "bag_0.mcap.original").touch()
    (path / "bag_0.mcap.journal").touch()
    with whole_file(path / FILE_NAME) as temporary:
        shutil.copy(temporary, path / ".metadata-abcdefgh.yaml")
    BagWriter(path, overwrite=True).close()
    assert sorted(files(path)) == ["bag_0.mcap", "metadata.yaml"]


def test_the_remedy_of_a_damaged_bag_is_a_command_that_mends_it(tmp_path):
    path = write_bag(tmp_path / "it's my $HOME; a&b *ü", ticks=3)
    (path / FILE_NAME).unlink()
    with pytest.raises(BagError) as error:
        Bag(path)
    command = str(error.value).split("save what is whole with: ")[1]
    assert shlex.split(command) == ["demos", "repair", str(path)]
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    subprocess.run(command, shell=True, env=environment, check=True, capture_output=True, timeout=60)
    assert Bag(path).message_count == 17
    assert remedy(path).endswith(command)


@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_the_remedy_of_a_compressed_bag_is_a_command_that_converts_it(tmp_path, mode):
    path = write_with_rosbags(tmp_path / "my bag", recording(30), mode)
    before = files(path)
    with pytest.raises(BagError) as error:
        Bag(path)
    with pytest.raises(BagError, match="convert it with"):
        repair(path)
    command = re.split("convert it with: ", str(error.value))[1]
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    subprocess.run(command, shell=True, env=environment, check=True, capture_output=True, timeout=60)
    assert_recording(Bag(Path(shlex.split(command)[4])))
    assert files(path) == before
