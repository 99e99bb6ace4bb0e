"""The descriptions of robot and task while they are recorded: the first hold, and a change is said."""

from dataclasses import fields

from rled_msgs_py.errors import ContractError
from rled_msgs_py.messages import decode
from rled_msgs_py.records import Text
from rled_msgs_py.task import TaskDescription
from rled_msgs_py.topics import TASK_DESCRIPTION, Topic

MAX_FIELDS_NAMED = 4
"""Fields of a task that are named when they change."""


class Descriptions:
    """Compares each description that comes with the one that the recording began with.

    Attributes:
        task: None before the first valid description.
        robot: URDF; empty before the first.
        warning: what is wrong with the newest one that does not fit; empty while all fit.
    """

    def __init__(self) -> None:
        self.task: TaskDescription | None = None
        self.robot = self.warning = ""

    def take(self, topic: Topic, data: bytes) -> bool:
        """Take a description; returns whether it is valid and the same as before."""
        try:
            record = decode(topic, data)
            assert isinstance(record, Text)
            change = (
                self._change_of_task(record.data) if topic == TASK_DESCRIPTION else self._change_of_robot(record.data)
            )
        except ContractError as error:
            change = str(error)
        if change:
            what = f"another {topic.name} came while recording ({change})"
            self.warning = f"{what}; the bag is divided there at its end if the simulation begins anew with it"
        return not change

    def _change_of_task(self, text: str) -> str:
        new = TaskDescription.from_json(text)
        old = self.task = self.task or new
        changed = [each.name for each in fields(old) if getattr(old, each.name) != getattr(new, each.name)]
        told = [f"{name} {getattr(old, name)}, now {getattr(new, name)}" for name in changed[:MAX_FIELDS_NAMED]]
        return ", ".join(told + (["..."] if len(changed) > MAX_FIELDS_NAMED else []))

    def _change_of_robot(self, text: str) -> str:
        self.robot = self.robot or text
        return "" if text == self.robot else "another robot"
