"""`--tensorboard`: curves of losses, learning rate and parameters, without torch."""

from __future__ import annotations

import struct
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from msnn.errors.failures import MissingExtraError
from msnn.packages import TENSORBOARD
from msnn.training.records.curves import Curves
from msnn.training.train import TrainingOptions, train
from tests.conditions import require_tool
from tests.full_disk import full_after
from tests.training.cases import dataset, gain, gain_series
from tests.training.stages.test_schedules import Epochs

STAGES = "  - {name: fit, epochs: 3, batch: 16, schedule: {exponential: {factor: 0.5}}}\n"
ALONE = """
import sys
from pathlib import Path
from msnn.training.records.curves import Curves
from msnn.training.train import TrainingOptions, train
from tests.training.cases import dataset, gain, gain_series
program, spec = gain("  - {epochs: 2, engine: native}\\n")
data = dataset(gain_series(100), train=[60], val=[30])
train(program, data, spec.train, TrainingOptions(runs=Path(sys.argv[1]), tensorboard=True))
print(*(name for name in ("torch", "tensorflow") if name in sys.modules))
"""


def run(runs: Path) -> Path:
    program, spec = gain(STAGES)
    data = dataset(gain_series(100), train=[60], val=[30])
    found = train(program, data, spec.train, TrainingOptions(runs=runs, tensorboard=True))
    assert found.folder is not None
    return found.folder


def scalars(folder: Path) -> dict[str, dict[int, float]]:
    """Every scalar of the event files of a run, by tag and step."""
    events: Any = import_module("tensorboard.compat.proto.event_pb2")
    found: dict[str, dict[int, float]] = {}
    for path in folder.glob("events.out.tfevents.*"):
        for record in records(path.read_bytes()):
            event = events.Event.FromString(record)
            for value in event.summary.value:
                found.setdefault(value.tag, {})[event.step] = value.simple_value
    return found


def records(content: bytes) -> Iterator[bytes]:
    """The records of a file of events: length, its checksum, content, its checksum."""
    place = 0
    while place < len(content):
        (length,) = struct.unpack_from("<Q", content, place)
        yield content[place + 12 : place + 12 + length]
        place += length + 16


def test_every_epoch_has_its_scalars(tmp_path: Path) -> None:
    pytest.importorskip("tensorboard")
    found = scalars(run(tmp_path))
    assert found["fit/lr"] == pytest.approx({1: 1e-3, 2: 5e-4, 3: 2.5e-4})
    assert set(found["fit/losses/x_next"]) == {1, 2, 3}
    assert found["fit/total"] == found["fit/losses/x_next"]
    assert len(set(found["fit/parameters/a"].values())) == 3
    assert set(found) >= {"fit/monitor", "fit/best", "fit/horizon", "fit/parameters/b"}


def test_it_needs_no_torch(tmp_path: Path) -> None:
    pytest.importorskip("tensorboard")
    require_tool("gcc", install="apt install gcc")
    said = subprocess.run(
        [sys.executable, "-c", ALONE, str(tmp_path)], check=True, capture_output=True, text=True
    )
    assert said.stdout == "\n"
    assert len(list(tmp_path.glob("gain/*/events.out.tfevents.*"))) >= 1


def test_without_it_nothing_begins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    with pytest.raises(MissingExtraError, match="tensorboard") as caught:
        run(tmp_path)
    assert caught.value.diagnostic.help == TENSORBOARD.install
    assert not list(tmp_path.iterdir())


def test_a_full_disk_leaves_whole_records_and_prints_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """TensorBoard's own writer has a thread, which prints a traceback then and names no file."""
    pytest.importorskip("tensorboard")
    heard = Epochs()
    program, spec = gain(STAGES)
    data = dataset(gain_series(100), train=[60], val=[30])
    train(program, data, spec.train, TrainingOptions(runs=None), heard)
    curves = Curves(tmp_path)

    def many() -> None:
        for event in heard.events * 10:
            curves.epoch_ended(event, {})

    with full_after(500), pytest.raises(OSError, match="too large") as caught:
        many()
    curves.close()
    (cut,) = tmp_path.iterdir()
    assert caught.value.filename == str(cut)
    assert 300 < cut.stat().st_size == sum(len(each) + 16 for each in records(cut.read_bytes()))
    assert capfd.readouterr().err == ""
