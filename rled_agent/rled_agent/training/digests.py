"""What an input holds, as a SHA-256: the same wherever it lies, another when something in it has changed."""

import hashlib
from pathlib import Path

from rled_msgs_py.bags import Bag
from rled_msgs_py.errors import RledError
from rled_msgs_py.topics import RECORDED


def file_digest(path: Path) -> str:
    """Of a file's bytes.

    Raises:
        RledError: it cannot be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise RledError(f"can't read {path} ({error.strerror or error})", "a file") from None


def bag_digest(bag: Bag) -> str:
    """Of the messages of a demonstration, topic by topic, each with its log time.

    A copy, a converted or a repaired bag has the same one. What lies beside the demonstration, on other topics, does
    not count.

    Raises:
        BagError: the bag is damaged.
    """
    topics = {topic.name: hashlib.sha256() for topic in RECORDED}
    for message in bag.messages(*RECORDED):
        digest = topics[bag.name_of(message)]
        digest.update(f"{message.log_time} {len(message.data)}\n".encode())
        digest.update(message.data)
    whole = "".join(f"{name} {digest.hexdigest()}\n" for name, digest in topics.items())
    return hashlib.sha256(whole.encode()).hexdigest()
