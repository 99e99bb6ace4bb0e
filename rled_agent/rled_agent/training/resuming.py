"""Whether a run that goes on is the run that began: the same settings, and the same content of the same files."""

from pathlib import Path
from typing import Any

from rled_msgs_py.errors import RledError

MAY_CHANGE = ("config.schedule.steps", "demonstrations.bag", "demonstrations.expert")
"""A run may go further, and its files may lie elsewhere."""
FILES = {"demonstrations.bag_sha256": "bag", "demonstrations.expert_sha256": "expert"}
"""The input that each digest is of."""
BEGIN_ANEW = "begin a new run with another --output"
SIMULATION = "demonstrations.simulation"


def require_same_run(began: dict[str, Any], now: dict[str, Any], folder: Path) -> None:
    """Refuse to go on with other settings or other files' content than a run began with.

    Args:
        began: what ``config.json`` says.
        now: the same of the command.
        folder: of the run.

    Raises:
        RledError: names what has changed, and what it was.
    """
    before, after = _flat({part: began.get(part) for part in now}), _flat(now)
    if (was := before.get("config.method")) is not None and was != after["config.method"]:
        what = f"the method is {after['config.method']}, and the run began with another"
        raise RledError(what, str(was)[:80], BEGIN_ANEW)
    if unshared := sorted(name for name in before.keys() ^ after.keys() if not name.startswith(SIMULATION)):
        more = f" and {len(unshared) - 3} more" if len(unshared) > 3 else ""
        what = f"the run in {folder} was begun by a version with other settings ({', '.join(unshared[:3])}{more})"
        raise RledError(what, "a run that this version began", BEGIN_ANEW)
    for digest, kind in FILES.items():
        if before[digest] != after[digest]:
            raise _other_content(kind, str(after[f"demonstrations.{kind}"]), str(before[f"demonstrations.{kind}"]))
    free = {*MAY_CHANGE, *FILES}
    changed = [name for name in before if name in after and before[name] != after[name] and name not in free]
    if changed:
        was = ", ".join(f"{name} {before[name]}" for name in changed)
        raise RledError(f"{', '.join(changed)} changed since the run began", was[:300], f"or {BEGIN_ANEW}")


def _other_content(kind: str, path: str, before: str) -> RledError:
    if path == before:
        what, accepted = f"what is in the {kind} {path} has changed since the run began", "its content of then"
    else:
        what, accepted = f"the {kind} {path} holds something else than the one that the run began with", before[:200]
    return RledError(what, accepted, f"bring it back (a copy elsewhere will do), or {BEGIN_ANEW}")


def _flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
    return flat
