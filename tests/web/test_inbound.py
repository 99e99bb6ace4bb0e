"""What a visitor may send: the kinds that the page uses, with values that its controls have."""

import dataclasses
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import msgspec.msgpack
import pytest
import viser
from hypothesis import given
from hypothesis import strategies as st
from rled_teleop.web.inbound import MAX_MESSAGE_SIZE, accepts, understood
from viser import _messages as messages

from .conftest import free_port

CAMERA = messages.ViewerCameraMessage((1, 0, 0, 0), (1, 1, 1), 0.8, 0.01, 100.0, 600, 800, (0, 0, 0), (0, 0, 1))
USED = [
    CAMERA,
    messages.TransformControlsDragStartMessage("/handle", "me"),
    messages.TransformControlsUpdateMessage("/handle", (1.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3), "me"),
    messages.TransformControlsDragEndMessage("/handle", "me"),
    messages.GuiUpdateMessage("id", {"value": True}),
    messages.GuiUpdateMessage("id", {"value": 0.5}),
    messages.GuiUpdateMessage("id", {"value": "y"}),
    messages.GuiButtonHoldMessage("id", 20.0),
    messages.LocalStorageGetItemResponseMessage(None, None, "id"),
]
NOTHING = [None, 1, float("nan"), "x", b"x", [1, 2, 3], {"a": {"b": "c"}}, True, "x" * 3000]


def sent(message: messages.Message, **other: Any) -> bytes:
    return msgspec.msgpack.encode(message.as_serializable_dict([]) | other)


def test_what_the_page_uses_reaches_viser_as_it_was_sent() -> None:
    for message in USED:
        passed = understood(sent(message))
        assert passed is not None
        assert messages.Message.deserialize(passed) == messages.Message.deserialize(sent(message))


def test_no_other_kind_of_viser_is_understood_whatever_it_holds() -> None:
    used = {type(each).__name__ for each in USED}
    kinds = [each for each in messages.Message.get_subclasses() if each.__name__ not in used]
    assert {"GuiFormDirtyMessage", "FileTransferPart", "ShareUrlRequest"} <= {each.__name__ for each in kinds}
    for kind in kinds:
        for value in NOTHING:
            fields = {field.name: value for field in dataclasses.fields(kind)}
            assert understood(msgspec.msgpack.encode(fields | {"type": kind.__name__})) is None


def test_only_the_value_of_a_control_can_be_set() -> None:
    for updates in [
        {},
        {"disabled": True},
        {"value": 1, "disabled": True},
        {"value": None},
        {"value": [1]},
        {"value": {}},
        {"value": float("nan")},
        {"value": float("inf")},
        {"value": 1e10},
        {"value": "x" * 1001},
        {"value": b"x"},
    ]:
        assert understood(sent(messages.GuiUpdateMessage("id", updates))) is None


def test_a_handle_is_dragged_to_a_point() -> None:
    for place in [(float("nan"), 0.0, 0.0), (float("inf"), 0.0, 0.0), (0.0, 0.0), (1e300,) * 3, "abc", None]:
        fields = {
            "type": "TransformControlsUpdateMessage",
            "name": "/handle",
            "wxyz": (1.0, 0.0, 0.0, 0.0),
            "owner": "",
        }
        assert understood(msgspec.msgpack.encode(fields | {"position": place})) is None


def test_other_fields_and_kinds_of_values_are_not_understood() -> None:
    for other in [{"junk": 1}, {"uuid": 7}, {"uuid": "x" * 201}, {"type": "Message"}, {"type": None}]:
        assert understood(sent(messages.GuiUpdateMessage("id", {"value": True}), **other)) is None


def test_a_kind_that_is_named_twice_is_passed_on_as_it_was_read() -> None:
    form = b"\xa4type\xb3GuiFormDirtyMessage"
    for pairs in (form + sent(USED[-2])[1:], sent(USED[-2])[1:] + form):
        passed = understood(b"\x84" + pairs)
        assert passed is None or messages.Message.deserialize(passed) == USED[-2]


def test_deep_nesting_is_not_understood() -> None:
    for depth in [10, 1000, 3900]:
        assert understood(b"\x82\xa1q" + b"\x91" * depth + b"\x01\xa4type\xb0GuiUpdateMessage") is None
        assert understood(b"\x91" * depth) is None


@given(st.binary(max_size=200) | st.text(max_size=20))
def test_noise_is_not_understood(data: bytes | str) -> None:
    assert understood(data) is None


def test_lengths_that_are_claimed_and_not_sent_are_not_believed() -> None:
    for head in (b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff", b"\xdb\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff"):
        assert understood(head) is None


def test_a_message_longer_than_any_of_the_page_is_not_read() -> None:
    assert understood(sent(USED[-1]) + b" " * MAX_MESSAGE_SIZE) is None


@pytest.fixture(scope="module")
def gui() -> Iterator[viser.GuiApi]:
    with closing(Server()) as server:
        yield server.gui


class Server(viser.ViserServer):
    """Viser's controls as they are; nobody visits them."""

    def __init__(self) -> None:
        super().__init__("127.0.0.1", free_port(), verbose=False)

    def close(self) -> None:
        self.stop()


def test_a_choice_is_one_of_those_offered(gui: viser.GuiApi) -> None:
    for control in (gui.add_dropdown("Bag", ("(none)", "one")), gui.add_button_group("Simulation", ("(none)", "one"))):
        assert accepts(control, "one")
        assert not any(accepts(control, each) for each in ("two", "/etc", "../one", "", 1, True, None))
    bags = gui.add_dropdown("Bag", ("(none)", "one"))
    bags.options = ("(none)", "two")
    assert accepts(bags, "two")
    assert not accepts(bags, "one")


def test_a_number_is_within_its_range(gui: viser.GuiApi) -> None:
    candidates = (-1, 0, 0.5, 1, 1.001, 1e308, float("nan"), float("inf"), True, "0.5", None, [0.5])
    for control in (gui.add_slider("joint", 0.0, 1.0, 0.1, 0.5), gui.add_number("Φ", 0.5, min=0.0, max=1.0)):
        assert [each for each in candidates if accepts(control, each)] == [0, 0.5, 1]
    assert accepts(gui.add_number("free", 0.5), -1e6)


def test_a_switch_is_on_or_off_and_nothing_else_is_set(gui: viser.GuiApi) -> None:
    for control in (gui.add_checkbox("Trail", False), gui.add_button("Drive")):
        assert accepts(control, True)
        assert accepts(control, False)
        assert not any(accepts(control, each) for each in (1, 0, 0.5, "x", None, []))
    for control in (gui.add_text("text", ""), gui.add_upload_button("file"), None):
        assert not any(accepts(control, each) for each in (True, 1, "x", b"x", None))
