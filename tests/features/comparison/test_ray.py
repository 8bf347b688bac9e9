"""Sweeps on a Ray cluster: the table of a local one, also where a node is killed meanwhile."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import msnn as api
from msnn.project.new_project import new_project
from msnn.training.records.run_log import LOG, read
from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC
from tests.conditions import require_package

KILLS = """
import json, os, signal, sys
from pathlib import Path

import ray
from ray.cluster_utils import Cluster

import msnn


class Killing:
    # kills the node on which all trainings run, and starts another one in its place

    def __init__(self, cluster, node):
        self.cluster, self.node, self.killed, self.heard = cluster, node, None, 0

    def began(self, trials):
        pass

    def ended(self, trial, outcome):
        self.heard += 1
        if self.node is not None and self.heard == 3:
            os.kill(self.node.all_processes["raylet"][0].process.pid, signal.SIGKILL)
            self.node, self.killed = None, self.node.node_id
            patiently(lambda: self.cluster.add_node(num_cpus=1))


def patiently(start):
    # Ray gives a raylet 30 s to start, and has no setting for that
    for attempt in range(5):
        try:
            return start()
        except Exception as error:
            if "timed out during startup" not in str(error) or attempt == 4:
                raise


if __name__ == "__main__":
    head = {"num_cpus": 0, "include_dashboard": False}
    cluster = patiently(lambda: Cluster(initialize_head=True, head_node_args=head))
    node = patiently(lambda: cluster.add_node(num_cpus=1))
    ray.init(cluster.address, log_to_driver=False)
    asked = {**json.loads(sys.argv[1]), "ray": "auto", "runs": "cluster"}
    killing = Killing(cluster, node)
    msnn.sweep(sys.argv[2], **asked, seeds=2, listener=killing)
    again = Killing(cluster, None)  # as a driver that is started anew
    msnn.sweep(sys.argv[2], **asked, seeds=3, listener=again)
    is_dead = {node["NodeID"]: not node["Alive"] for node in ray.nodes()}
    said = [killing.heard, again.heard, is_dead[killing.killed]]
    Path("said.json").write_text(json.dumps(said))
    ray.shutdown()
    cluster.shutdown()
"""
SURROUNDINGS = {
    "RAY_USAGE_STATS_ENABLED": "0",
    # on a machine with much else to do a process is slow to answer, and not dead
    "RAY_health_check_failure_threshold": "20",
    "RAY_worker_register_timeout_seconds": "600",
}
ASKED: dict[str, Any] = {
    "grid": {"integrator": ["rk4", "euler"]},
    "settings": {
        "train.0.epochs": 200,
        "train.0.early_stop.patience": 200,
        "data.split": {"by": "kfold", "k": 2},
    },
    "folds": True,
}


@pytest.fixture
def msnn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> CommandLine:
    """The command line in a fresh project."""
    folder = new_project(tmp_path / "plant")
    monkeypatch.chdir(folder)
    return CommandLine(folder, capsys)


def test_every_result_is_there_once_though_a_node_is_killed(msnn: CommandLine):
    """Row by row what one process finds: scores, weights, and one line a training in the log."""
    require_package("ray", install="pip install 'msnn[ray]'")
    Path("kills.py").write_text(KILLS)
    said = subprocess.run(
        [sys.executable, "kills.py", json.dumps(ASKED), SPEC],
        capture_output=True,
        text=True,
        env={**os.environ, **SURROUNDINGS, "PYTHONPATH": os.pathsep.join(sys.path)},
        check=False,
    )
    assert said.returncode == 0, said.stdout + said.stderr
    assert json.loads(Path("said.json").read_text()) == [8, 12, True]

    local = api.sweep(SPEC, **ASKED, seeds=3, runs="local")
    assert local.best is not None
    here, there = (read(Path(runs) / LOG) for runs in ("local", "cluster"))
    assert len(there) == len({line.key for line in there}) == 12
    found = {line.key: line for line in there}
    for line in here:
        other = found[line.key]
        assert (line.held_out, line.training) == (other.held_out, other.training)
        assert (line.spec, line.settings, line.folder) == (other.spec, other.settings, other.folder)
        kept = [
            json.loads((Path(runs) / str(line.folder) / "run.json").read_text())
            for runs in ("local", "cluster")
        ]
        assert kept[0]["spec_places"] == kept[1]["spec_places"]
        weights = [
            (Path(runs) / str(line.folder) / "weights.safetensors").read_bytes()
            for runs in ("local", "cluster")
        ]
        assert weights[0] == weights[1]


def test_a_cluster_that_is_not_there_is_told(msnn: CommandLine):
    require_package("ray", install="pip install 'msnn[ray]'")
    said = msnn("sweep", SPEC, "--ray", "nowhere")
    assert said.code == 1
    assert "error[E0864]" in said.err
    assert not Path("runs").exists()
