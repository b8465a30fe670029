"""A cluster for all tests of this folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

#: A busy machine is no lost one: its processes may take minutes to begin, and its heart to beat.
_PATIENT = {
    "RAY_worker_register_timeout_seconds": "600",
    "RAY_health_check_initial_delay_ms": "600000",
    "RAY_health_check_timeout_ms": "600000",
    "RAY_memory_monitor_refresh_ms": "0",  # what else fills this machine is not for it to end
}
_NODE = {"num_cpus": 1, "object_store_memory": 80 << 20}  # /dev/shm may be small


@pytest.fixture(scope="session")
def two_nodes() -> Iterator[Any]:
    """A cluster of two nodes on this machine: each with one CPU and processes of its own."""
    ray = pytest.importorskip("ray")
    cluster_utils = pytest.importorskip("ray.cluster_utils")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))  # actors import the tests
        for name, value in _PATIENT.items():
            patch.setenv(name, value)
        cluster = cluster_utils.Cluster(
            initialize_head=True, head_node_args={**_NODE, "include_dashboard": False}
        )
        cluster.add_node(**_NODE)
        cluster.wait_for_nodes()
        patch.setenv("RAY_ADDRESS", cluster.address)
        yield cluster
    ray.shutdown()
    cluster.shutdown()
