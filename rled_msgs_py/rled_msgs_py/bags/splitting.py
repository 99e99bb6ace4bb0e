"""A recording during which the descriptions changed, divided into bags of its parts."""

from itertools import count
from math import inf
from pathlib import Path

from rled_msgs_py.bags.bag import Bag
from rled_msgs_py.bags.copies import trim
from rled_msgs_py.bags.holding import temporary_folder
from rled_msgs_py.bags.writer import making_way


def split(path: Path) -> list[Path]:
    """Divide a bag: the first part keeps its name, the others are put beside it, as NAME_2 and so on.

    Messages that describe another robot or task are left out. The bag is replaced when all parts are there.

    Returns:
        The bags of the parts, in order.

    Raises:
        BagError: the bag is damaged, or a part cannot be written.
    """
    bag, paths = Bag(path, 1), [path]
    if not bag.note:
        return paths
    for part in range(2, bag.parts + 1):
        paths.append(_free_name(path))
        trim(Bag(path, part), paths[-1], -inf, inf, lambda _: None)
    with temporary_folder(path) as room:
        trim(bag, room / path.name, -inf, inf, lambda _: None)
        with making_way(path, overwrite=True):
            (room / path.name).rename(path)
    return paths


def _free_name(path: Path) -> Path:
    return next(each for number in count(2) if not (each := path.with_name(f"{path.name}_{number}")).exists())
