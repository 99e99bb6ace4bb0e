"""Texts from elsewhere are read, or refused before they cost anything."""

import os
import time
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from rled_msgs_py.errors import ContractError
from rled_msgs_py.untrusted import MAX_DEPTH, MAX_NODES, MAX_TEXT, read_json, read_text, read_yaml

SCALARS = st.none() | st.booleans() | st.integers(-(2**63), 2**63) | st.text(max_size=20)
CONTENTS = st.recursive(SCALARS, lambda inner: st.lists(inner) | st.dictionaries(st.text(max_size=5), inner))

EXPANDING = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{number}: &a{number} [{', '.join([f'*a{number - 1}'] * 10)}]\n" for number in range(1, 10)
)
TALL = "a0: &a0 [x]\n" + "".join(f"a{number}: &a{number} [*a{number - 1}]\n" for number in range(1, 100))


@given(CONTENTS)
def test_yaml_that_others_write_is_read_as_they_meant_it(content):
    text = yaml.safe_dump(content)
    assert read_yaml(text, "it") == yaml.safe_load(text)


def test_aliases_stand_for_what_they_repeat():
    assert read_yaml("a: &x {depth: 10}\nb: [*x, *x]", "it") == {"a": {"depth": 10}, "b": [{"depth": 10}] * 2}


def test_yaml_without_measure_is_refused_at_once():
    for text, said in [
        ("[" * 30_000, "nested too deeply"),
        ("{a: " * 30_000, "nested too deeply"),
        ("- " * 30_000, "nested too deeply"),
        (EXPANDING, "too many parts"),
        (TALL, "nested too deeply"),
        ("a: &a [*a]", "not complete"),
        ("- a\n" * (MAX_NODES + 1), "too many parts"),
        ("x" * (MAX_TEXT + 1), "too large"),
        ("a: 1" + ":1" * 100_000, "a number of 200001 characters"),
        ("!!int 'abc'", "no YAML"),
        ("!!timestamp x", "no YAML"),
        ("!!python/object/apply:os.system [true]", "no YAML"),
        ("[a", "no YAML"),
        ("\0", "no YAML"),
    ]:
        begun = time.process_time()
        with pytest.raises(ContractError, match=said) as caught:
            read_yaml(text, "the metadata")
        assert str(caught.value).startswith("the metadata ")
        assert time.process_time() - begun < 2.0


def test_nesting_is_accepted_up_to_its_bound():
    nested = "[" * MAX_DEPTH + "]" * MAX_DEPTH
    assert read_yaml(nested, "it") == read_json(nested, "it")
    for read in (read_yaml, read_json):
        with pytest.raises(ContractError, match="nested too deeply"):
            read(f"[{nested}]", "it")


def test_json_without_measure_is_refused():
    for text, said in [
        ("[" * 100_000, "nested too deeply"),
        ('{"a":' * 100 + "1" + "}" * 100, "nested too deeply"),
        ("1" * 5000, "no JSON"),
        ("[1,", "no JSON"),
        ("", "no JSON"),
        ("[" + "1," * MAX_NODES + "1]", "too many parts"),
        ('"' + "x" * MAX_TEXT + '"', "too large"),
    ]:
        with pytest.raises(ContractError, match=said):
            read_json(text, "it")


def test_a_file_is_read_as_utf_8(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_bytes("Δq".encode())
    assert read_text(path, "it") == "Δq"


@pytest.mark.parametrize(("data", "said"), [(b"\xff\xfe\x00", "not UTF-8 at byte 0"), (b"x" * 11, "too large")])
def test_a_file_of_another_encoding_or_size_is_refused(data, said, tmp_path):
    path = tmp_path / "a.yaml"
    path.write_bytes(data)
    with pytest.raises(ContractError, match=said):
        read_text(path, "it", limit=10)


def test_what_is_no_regular_file_is_refused_and_not_waited_for(tmp_path):
    with pytest.raises(ContractError, match="no regular file"):
        read_text(Path("/dev/zero"), "it")
    with pytest.raises(IsADirectoryError):
        read_text(tmp_path, "it")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ContractError, match="no regular file"):
        read_text(tmp_path / "pipe", "it")
