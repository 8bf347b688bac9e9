"""Rule R10: rows that are not used may lack values; those that are used may not."""

from __future__ import annotations

from pathlib import Path

import pytest

from msnn.data.dataset import Dataset
from msnn.data.reading.load import load_data
from msnn.data.reading.row_filter import row_filters
from msnn.model.load import load_model
from spec_schema.diagnostics.diagnostic import SpecError

SPEC = """
msnn: 1
name: plant
sample_time: 0.2 s
inputs: {x: m, F: N}
outputs: {y: "x * 2", z: "F * 2"}
data:
  source: {train: a.csv}
  time: time
"""


def load(folder: Path, more: str, x: list[str], force: list[str]) -> Dataset:
    rows = [f"{0.2 * i:.1f},{a},{b}" for i, (a, b) in enumerate(zip(x, force, strict=True))]
    (folder / "a.csv").write_text("\n".join(["time,x,F", *rows]) + "\n")
    (folder / "plant.yaml").write_text(SPEC + "".join(f"  {line}\n" for line in more.splitlines()))
    model = load_model(folder / "plant.yaml")
    assert model.spec.data is not None
    return load_data(model.program, model.spec.data, folder, row_filters(model.spec))


FORCE = [str(i) for i in range(10)]
LEFT_OUT = {
    "from: 4\n": 3,
    "from: 0.8 s\n": 0,
    "to: 4\n": 5,
    "to: 1 s\n": 9,
    'filter: "F > 3"\n': 2,
    'filter: "F < 3"\n': 8,
}


@pytest.mark.parametrize("how", ["", "resample: linear\n"])
@pytest.mark.parametrize("choice", LEFT_OUT)
@pytest.mark.parametrize("nan", ["error", "drop", "split"])
@pytest.mark.parametrize("text", ["", "NA", "nan"])
def test_a_value_that_is_missing_in_a_row_left_out_is_no_fault(
    tmp_path: Path, how: str, choice: str, nan: str, text: str
) -> None:
    x = [str(i) for i in range(10)]
    whole = load(tmp_path, f"{how}{choice}nan: {nan}\n", x, FORCE)
    x[LEFT_OUT[choice]] = text
    data = load(tmp_path, f"{how}{choice}nan: {nan}\n", x, FORCE)
    assert data.episodes("train").tolist() == whole.episodes("train").tolist()
    assert len(whole.episodes("train")) == 1
    assert not [w for w in data.warnings if w.code == "W0803"]
    # one row farther it is missing
    x = [str(i) for i in range(10)]
    x[6 if ">" in choice or "from" in choice else 1] = text
    if nan == "split":
        assert load(tmp_path, f"{how}{choice}nan: split\n", x, FORCE).episodes("train").size
    elif nan == "drop":
        assert load(tmp_path, f"{how}{choice}nan: drop\n", x, FORCE).rows == 0
    else:
        with pytest.raises(SpecError, match="E0809"):
            load(tmp_path, f"{how}{choice}nan: error\n", x, FORCE)


def test_every_leaves_rows_out(tmp_path: Path) -> None:
    x = ["" if i % 2 else str(i) for i in range(10)]
    text = SPEC.replace("0.2 s", "0.4 s")
    rows = [f"{0.2 * i:.1f},{a},1" for i, a in enumerate(x)]
    (tmp_path / "a.csv").write_text("\n".join(["time,x,F", *rows]) + "\n")
    (tmp_path / "plant.yaml").write_text(f"{text}  every: 2\n")
    model = load_model(tmp_path / "plant.yaml")
    assert model.spec.data is not None
    data = load_data(model.program, model.spec.data, tmp_path)
    assert data.series["x"].tolist() == [0, 2, 4, 6, 8]


@pytest.mark.parametrize("how", ["", "resample: linear\n"])
def test_a_filter_does_not_hide_what_it_cannot_know(tmp_path: Path, how: str) -> None:
    """Where the filter's own signal is missing, nobody knows whether it would keep the row."""
    x = [str(i) for i in range(10)]
    x[4] = ""
    with pytest.raises(SpecError, match="E0809") as caught:
        load(tmp_path, f'{how}filter: "x > 2"\n', x, FORCE)
    (fault,) = caught.value.diagnostics
    assert fault.span is not None
    assert (fault.span.line, fault.span.column) == (6, 5)


@pytest.mark.parametrize("how", ["", "resample: linear\n"])
def test_rows_that_a_filter_leaves_out_drop_no_record(tmp_path: Path, how: str) -> None:
    x = [str(i) for i in range(10)]
    data = load(tmp_path, f'{how}nan: drop\nfilter: "x > 4"\n', x, FORCE)
    assert data.episodes("train").tolist() == [[5, 10]]
    assert not data.warnings


@pytest.mark.parametrize("how", ["linear", "nearest"])
@pytest.mark.parametrize("choice", ["every: 3\n", "every: 3\nfrom: 3\n", "every: 3\nto: 6\n"])
@pytest.mark.parametrize("nan", ["error", "drop", "split"])
def test_an_input_without_any_value_in_the_picked_rows_is_missing(
    tmp_path: Path, how: str, choice: str, nan: str
) -> None:
    """`every: 3` picks the rows between the values of x: resampling has none to take."""
    x = [str(i) if i % 3 else "" for i in range(10)]
    section = f"resample: {how}\n{choice}nan: {nan}\n"
    if nan == "error":
        with pytest.raises(SpecError, match="E0809"):
            load(tmp_path, section, x, FORCE)
        return
    data = load(tmp_path, section, x, FORCE)
    assert not data.usable.any()
    assert (data.rows == 0) == (nan == "drop")


@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), ("ms", 1e3), ("min", 1 / 60)])
@pytest.mark.parametrize("begin", [0.0, 1.103, 3.2])
def test_the_last_row_does_not_depend_on_the_unit_of_the_time(
    tmp_path: Path, unit: str, factor: float, begin: float
) -> None:
    """The last value is 1 % of the sample time before its row, which is kept by rule R10."""
    times = (begin + 0.074 * i for i in range(28))
    rows = [f"{round(t, 6) * factor!r},{i},{i}" for i, t in enumerate(times)]
    (tmp_path / "a.csv").write_text("\n".join([f"time [{unit}],x,F", *rows]) + "\n")
    (tmp_path / "plant.yaml").write_text(SPEC + "  resample: linear\n")
    model = load_model(tmp_path / "plant.yaml")
    assert model.spec.data is not None
    assert load_data(model.program, model.spec.data, tmp_path).rows == 11
