"""Processes that train together: the losses of one, and what becomes of a run that loses one."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file

from tests.cli.test_working_folder import NAMES, STRANGERS, plant
from tests.command_server import commands
from tests.conditions import require_package, require_tool

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="gloo is tried on POSIX")

SPEC = """
msnn: 1
name: plant
sample_time: 0.01 s
inputs: {{u: {{}}, x: {{}}}}
layers:
  h: {{fir: {{window: 4}}}}
  g: {{fir: {{window: 4}}}}
outputs:
  y: {{expr: "tanh(h(x)) + g(u)", predicts: "x[t+1]"}}
data: {{source: {{train: train.npz, val: val.npz}}}}
train:
  - {{name: gradients, epochs: {epochs}, batch: 512, rollout: {{horizon: 6, stride: 3}},
     optimizer: {{adam: {{lr: 0.003}}}}{more}}}
  - {{name: squares, epochs: 3, rollout: {{horizon: 6, stride: 6}}, optimizer: levenberg_marquardt}}
"""

LM_TOLERANCE = 1e-12
"""Ranks add their normal matrices one after the other: a sum of n numbers in another order is off
by n ε at most, 3e-12 for the 1e4 squares here, by √n ε = 2e-14 as a rule (Higham, Accuracy and
Stability of Numerical Algorithms, 4.2), and steps that lower the total forget such differences."""


@pytest.fixture(autouse=True)
def _needed() -> None:
    require_tool("gcc", install="apt install gcc")
    require_package("torch", install="pip install 'msnn[torch]'")


def written(folder: Path, epochs: int = 4, more: str = "") -> Path:
    """A spec with its data in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(0)
    for name, rows in (("train", 12000), ("val", 2000)):
        u, x = rng.normal(size=rows), np.zeros(rows)
        for t in range(1, rows - 1):
            x[t + 1] = np.tanh(0.6 * x[t] - 0.2 * x[t - 1]) + 0.3 * u[t] + 0.1 * u[t - 1]
        np.savez(folder / f"{name}.npz", u=u, x=x + 0.01 * rng.normal(size=rows))
    (folder / "plant.yaml").write_text(SPEC.format(epochs=epochs, more=more))
    return folder


def environment() -> dict[str, str]:
    return {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@pytest.fixture(scope="module")
def forked(tmp_path_factory: pytest.TempPathFactory) -> Generator[str]:
    """The command `msnn` as a fork that has torch: half of what a rank computes is that import."""
    require_package("torch", install="pip install 'msnn[torch]'")
    with commands(tmp_path_factory.mktemp("commands"), "torch.distributed") as folder:
        yield str(folder / "msnn")


def alone(msnn: str, folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    words = [msnn, "train", "plant.yaml", *options]
    return subprocess.run(
        words, cwd=folder, env=environment(), text=True, capture_output=True, check=False
    )


def by_torchrun(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    # without `--standalone` all runs of a machine ask for one port
    torchrun = [Path(sys.executable).parent / "torchrun", "--standalone", "--nproc-per-node", "2"]
    words = [*torchrun, "-m", "msnn", "train", "plant.yaml", *options]
    return subprocess.run(
        words,
        cwd=folder,
        env={**environment(), "PYTHONPATH": ""},
        text=True,
        capture_output=True,
        check=False,
    )


class Started:
    """Ranks as torchrun starts them, without the agent that would end them for each other."""

    def __init__(
        self,
        msnn: Sequence[str],
        folders: Sequence[Path],
        *options: str,
        more: Mapping[str, str] | None = None,
    ) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        words = [*msnn, "train", "plant.yaml", *options]
        place = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port), "WORLD_SIZE": "2"}
        place |= more or {}
        self.folders = folders
        self.processes = [
            subprocess.Popen(
                words,
                cwd=folder,
                env={
                    **environment(),
                    **place,
                    "RANK": str(rank),
                    "TORCHELASTIC_RUN_ID": "test",
                    "TELL_PROCESS": str(folder / f"rank_{rank}"),
                },
                text=True,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
            )
            for rank, folder in enumerate(folders)
        ]

    def ended(self, rank: int) -> tuple[int, str]:
        """Its exit code and what it said."""
        process = self.processes[rank]
        out, errors = process.communicate(timeout=120)
        return process.returncode, out + errors

    def kill(self, rank: int) -> None:
        """Of a command that is a fork, what computes."""
        os.kill(int((self.folders[rank] / f"rank_{rank}").read_text()), signal.SIGKILL)

    def end(self) -> None:
        for rank, process in enumerate(self.processes):
            if process.poll() is None:
                self.kill(rank)
            process.communicate()


@pytest.fixture
def two(forked: str, tmp_path: Path) -> Iterator[Started]:
    """Two ranks on a training that lasts."""
    folder = written(tmp_path / "run", epochs=LONG)
    found = Started([forked], (folder, folder))
    yield found
    found.end()


LAST_WORD = """
import atexit, ctypes, os
late = ctypes.PyDLL(os.environ["LD_PRELOAD"])
atexit.register(late.hold_the_lock)  # what is registered first is called last

from msnn.training.ranks.gloo_ranks import GlooRanks
ranks = GlooRanks()
late.let_threads_be_late()
ranks.most([1.0])
"""
"""A program that ends right after the ranks have exchanged something."""

SLOW_QUESTION = """
import os, time
from msnn.training.ranks.gloo_ranks import GlooRanks
import torch.distributed

# a fork: to import torch takes longer than all else
rank = 1 if os.fork() == 0 else 0
os.environ["RANK"] = str(rank)
ranks = GlooRanks()
time.sleep(2 * rank)
os.write(1, f"{rank} {ranks.is_speaker()}\\n".encode())
if rank == 0:
    os.wait()
"""
"""A program whose second rank asks who speaks long after the first."""

LONG = 200
"""Epochs of a training that is there to be killed: some seconds of two ranks."""


def run_of(folder: Path) -> Path:
    (found,) = (path for path in (folder / "runs/plant").iterdir() if path.name != "latest")
    return found


def wait_for(path: Path, process: subprocess.Popen[str], lines: int = 0) -> None:
    for _ in range(6000):
        if path.is_file() and path.read_bytes().count(b"\n") >= lines:
            return
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)
    pytest.fail(f"{path} was not written")


def metrics(run: Path) -> list[dict[str, Any]]:
    lines = (run / "metrics.jsonl").read_text().splitlines()
    return [{k: v for k, v in json.loads(line).items() if k != "seconds"} for line in lines]


def assert_alike(ours: Path, one: Path) -> None:
    """Gradients to the bit, squares to LM_TOLERANCE."""
    for mine, other in zip(metrics(ours), metrics(one), strict=True):
        if mine["stage"] == "gradients":
            assert mine == other
        else:
            assert mine["total"] == pytest.approx(other["total"], rel=LM_TOLERANCE)
            assert mine["monitor"] == pytest.approx(other["monitor"], rel=LM_TOLERANCE)


def test_torchrun_trains_as_one_process_and_keeps_one_run(forked: str, tmp_path: Path) -> None:
    folder = written(tmp_path / "two")
    # `python -m` looks in the working folder itself, for what Python needs to begin
    for name in NAMES - set(sys.stdlib_module_names):
        plant(folder, name)
    found = by_torchrun(folder)
    assert found.returncode == 0, found.stderr
    assert found.stdout.count("kept in") == 1  # one of the ranks speaks
    assert found.stderr.count("stage 2/2") == 1
    assert not (folder / STRANGERS).exists()
    run = run_of(folder)
    assert (folder / "runs/plant/latest").resolve() == run.resolve()
    assert len((folder / "runs/runs.jsonl").read_text().splitlines()) == 1
    one = written(tmp_path / "one")
    assert alone(forked, one).returncode == 0
    assert_alike(run, run_of(one))
    mine, other = (
        json.loads((path / "parameters.json").read_text()) for path in (run, run_of(one))
    )
    assert list(mine) == list(other)  # standard errors come from both ranks


def test_ranks_end_well_where_a_thread_of_gloo_ends_late(tmp_path: Path) -> None:
    late = tmp_path / "late_threads.so"
    source = Path(__file__).with_name("late_threads.c")
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", late, source, "-ldl"], check=True)
    ranks = Started(
        [sys.executable, "-c", LAST_WORD], (tmp_path, tmp_path), more={"LD_PRELOAD": str(late)}
    )
    found = [ranks.ended(rank) for rank in range(2)]
    assert [code for code, _ in found] == [0, 0], found


def test_the_first_rank_stays_until_all_have_asked_who_speaks(tmp_path: Path) -> None:
    ranks = Started([sys.executable, "-c", SLOW_QUESTION], (tmp_path,))
    assert ranks.ended(0) == (0, "0 True\n1 False\n")


def test_a_rank_that_is_killed_ends_the_other_which_keeps_the_state(
    two: Started, forked: str, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    runs = folder / "runs/plant"
    while not runs.is_dir():
        assert two.processes[0].poll() is None, two.ended(0)
        time.sleep(0.02)
    run = run_of(folder)
    wait_for(run / "metrics.jsonl", two.processes[0], lines=5)
    two.kill(1)
    code, said = two.ended(0)
    assert code == 1
    assert "E0867" in said
    assert str(run.relative_to(folder)) in said
    assert (runs / "latest").resolve() == run.resolve()
    kept = metrics(run)
    assert len(kept) < LONG
    assert json.loads((run / "run.json").read_text())["end"]["state"] == "interrupted"

    again = Started([forked], (folder, folder), "--resume")
    for ended, told in (again.ended(rank) for rank in range(2)):
        assert ended == 0, told
    one = written(tmp_path / "one", epochs=LONG)
    assert alone(forked, one).returncode == 0
    assert_alike(run, run_of(one))
    ours, right = (load_file(path / "weights.safetensors") for path in (run, run_of(one)))
    for name, value in right.items():
        np.testing.assert_allclose(ours[name], value, rtol=1e-9)


def test_the_death_of_the_first_rank_ends_the_others(
    two: Started, forked: str, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    runs = folder / "runs/plant"
    while not runs.is_dir():
        assert two.processes[0].poll() is None, two.ended(0)
        time.sleep(0.02)
    run = run_of(folder)
    wait_for(run / "checkpoint.safetensors", two.processes[0])
    two.kill(0)
    code, said = two.ended(1)
    assert code == 1
    assert "E0867" in said
    again = alone(forked, folder, "--resume")  # one process goes on with what two have begun
    assert again.returncode == 0, again.stderr
    assert metrics(run)[-1]["stage"] == "squares"


@pytest.mark.parametrize(
    ("more", "options", "code"),
    [(", engine: torch", (), "E0865"), ("", ("--folds",), "E0868"), (", nothing: 1", (), "E02")],
)
def test_what_ranks_cannot_do_is_said_once(
    more: str, options: tuple[str, ...], code: str, forked: str, tmp_path: Path
) -> None:
    folder = written(tmp_path / "run", more=more)
    ranks = Started([forked], (folder, folder), *options)
    found = [ranks.ended(rank) for rank in range(2)]
    assert [one for one, _ in found] == [1, 1]
    assert len(re.findall(rf"error\[{code}", "".join(said for _, said in found))) == 1


def test_ranks_with_other_data_do_not_train(forked: str, tmp_path: Path) -> None:
    folder, other = written(tmp_path / "run"), written(tmp_path / "other")
    np.savez(other / "val.npz", u=np.ones(2000), x=np.ones(2000))
    ranks = Started([forked], (folder, other))
    found = [ranks.ended(rank) for rank in range(2)]
    assert [code for code, _ in found] == [1, 1]
    assert "".join(said for _, said in found).count("error[E0866]") == 1
