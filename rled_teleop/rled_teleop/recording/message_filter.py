"""Which received bytes are messages at all: what nobody can read would only fill the disk."""

from collections import Counter
from collections.abc import Callable

from rled_msgs_py.errors import ContractError, Unreadable
from rled_msgs_py.messages import FROM, decode, require_size
from rled_msgs_py.topics import Topic


class MessageFilter:
    """Judges received bytes. A message that is wrong in what it says is one all the same: who reads the bag judges it.

    Args:
        say: told of the first refusal on each topic.

    Attributes:
        refused: how many on each topic, by name.
    """

    def __init__(self, say: Callable[[str], object]) -> None:
        self._say = say
        self.refused: Counter[str] = Counter()

    def accepts(self, topic: Topic, data: bytes) -> bool:
        """Whether bytes are a message of a topic."""
        try:
            require_size(topic, data)
            if topic.name in FROM:
                decode(topic, data)
        except Unreadable as error:
            if not self.refused[topic.name]:
                self._say(f"{topic.name}: {error}; it is not recorded, and no other like it")
            self.refused[topic.name] += 1
            return False
        except ContractError:
            pass
        return True
