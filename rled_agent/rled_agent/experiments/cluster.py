"""Runs on a Ray cluster: what a job needs goes there, its files come back, and a lost worker's jobs are begun again."""

import os
from collections.abc import Mapping
from pathlib import Path
from threading import Event
from typing import Any

from rled_msgs_py.errors import RledError

from rled_agent.experiments.execution import Stopped, execute
from rled_agent.experiments.jobs import Job

POLL_PERIOD = 0.5
"""Seconds between two looks at a run, and at the request to stop."""
WEIGHTS_AND_FIGURES = (".safetensors", ".json", ".csv")
NOT_NEEDED = "checkpoint.safetensors"


class Cluster:
    """Makes jobs on the nodes of a Ray cluster, each a population on one processor, or on one GPU.

    The project lies at the same path on every node, set up by ``make setup``; the folder of runs need not be shared,
    but if it is, a run that was lost goes on from its checkpoint.

    Args:
        address: of the cluster, as ``auto`` or ``ray://host:10001``.
        root: folder of all runs, here and there.
        stop: set to end early.
        device: that jobs are made on.

    Raises:
        RledError: Ray is not installed, or there is no cluster.
    """

    def __init__(self, address: str, root: Path, stop: Event, device: str = "cpu") -> None:
        try:
            import ray
        except ImportError:
            raise RledError("Ray is not installed", "", "pip install 'ray[default]'") from None
        self._ray, self._root, self._stop, self._device = ray, root, stop, device
        try:
            ray.init(address=address, log_to_driver=False, logging_level="ERROR", ignore_reinit_error=True)
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise RledError(f"no Ray cluster at {address} ({error})", "", "ray start --head") from None
        self._task = ray.remote(_remotely).options(num_cpus=1, num_gpus=int(device != "cpu"), max_retries=-1)

    @property
    def processors(self) -> int:
        """Jobs that fit at once."""
        resource = "CPU" if self._device == "cpu" else "GPU"
        return max(1, int(self._ray.cluster_resources().get(resource, 1)))

    def make(self, job: Job) -> list[Path]:
        """Make a job somewhere and bring its files here.

        Raises:
            Stopped: ``stop`` was set.
            RledError: the command failed.
        """
        needed = {str(need.folder): _files(self._root / need.folder) for need in job.needs}
        coming = self._task.remote(job, str(Path.cwd()), str(self._root), needed)
        while not self._ray.wait([coming], timeout=POLL_PERIOD)[0]:
            if self._stop.is_set():
                self._ray.cancel(coming, force=True)
                raise Stopped(f"{job} was stopped")
        try:
            files = self._ray.get(coming)
        except self._ray.exceptions.RayTaskError as error:
            raise RledError(f"{job}: {error.cause}") from None
        for folder, content in files.items():
            _write(self._root / folder, content)
        return [self._root / folder for folder in files]


def _remotely(
    job: Job, project: str, root: str, needed: Mapping[str, Mapping[str, bytes]]
) -> dict[str, dict[str, bytes]]:
    """What a worker does; returns the files of each run by its folder."""
    os.chdir(project)
    for folder, files in needed.items():
        _write(Path(root, folder), files)
    return {str(folder.relative_to(root)): _files(folder) for folder in execute(job, Path(root), Event())}


def _files(folder: Path) -> dict[str, bytes]:
    kept = (path for path in folder.iterdir() if path.suffix in WEIGHTS_AND_FIGURES and path.name != NOT_NEEDED)
    return {path.name: path.read_bytes() for path in kept}


def _write(folder: Path, files: Mapping[str, Any]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)
