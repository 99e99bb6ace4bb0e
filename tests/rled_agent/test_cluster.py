"""Runs on Ray's own cluster of several nodes on one machine."""

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event

import pytest
import ray
from ray.cluster_utils import Cluster as LocalNodes
from rled_agent.experiments.cluster import Cluster
from rled_agent.experiments.execution import is_done
from rled_agent.experiments.experiment import Run, RunName
from rled_agent.experiments.jobs import Job
from rled_msgs_py.errors import RledError

PENDULUM = ("train_agent", "pendulum", "--schedule.log-every", "100", "--schedule.evaluate-every", "1000")
SMALL = ("--learner.actor.hidden", "8", "--learner.critic.hidden", "8", "--schedule.batch-size", "8")


def run(name: str, *options: str) -> Run:
    return Run(RunName("e", name, 0), (*PENDULUM, *SMALL, *options))


@pytest.fixture
def nodes() -> Iterator[LocalNodes]:
    """A head that makes no runs itself."""
    nodes = LocalNodes(initialize_head=True, head_node_args={"num_cpus": 0})
    yield nodes
    ray.shutdown()
    nodes.shutdown()


def test_a_run_of_a_lost_worker_is_made_by_another(nodes, tmp_path):
    worker = nodes.add_node(num_cpus=1)
    cluster = Cluster(nodes.address, tmp_path, Event())
    assert cluster.processors == 1
    long = run("long", "--schedule.steps", "3000")
    with ThreadPoolExecutor(1) as pool:
        made = pool.submit(cluster.make, Job((long,)))
        while not (tmp_path / long.name.folder / "metrics.csv").exists():
            assert not made.done(), made.result()
            time.sleep(0.01)
        nodes.remove_node(worker, allow_graceful=False)
        assert not is_done(tmp_path, long)
        nodes.add_node(num_cpus=1)
        assert made.result(timeout=120) == [tmp_path / long.name.folder]
    assert is_done(tmp_path, long)
    assert (tmp_path / long.name.folder / "metrics.csv").read_text().splitlines()[-1].startswith("3000.0,")


def test_a_failed_run_says_why_from_afar(nodes, tmp_path):
    nodes.add_node(num_cpus=1)
    cluster = Cluster(nodes.address, tmp_path, Event())
    with pytest.raises(RledError, match="steps is 0"):
        cluster.make(Job((run("bad", "--schedule.steps", "0"),)))


def test_no_cluster_is_said(tmp_path: Path):
    with pytest.raises(RledError, match="no Ray cluster at auto"):
        Cluster("auto", tmp_path, Event())
