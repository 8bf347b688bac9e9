"""A unit in capital letters is read where one unit fits, and asked where several do."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import polars as pl
import pytest
from asammdf import MDF, Signal
from scipy.io import savemat

import msnn
from msnn.data.dataset import Dataset
from msnn.data.reading.frames import frame_data
from spec_schema.diagnostics.diagnostic import SpecError
from tests.data.unit_files import TIME, WRITERS, V, load, read


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize(
    ("stated", "unit", "first"),
    [
        # nobody writes megametres, and no other unit fits
        ("MM", "m", 0.036),
        ("MBAR", "Pa", 3600.0),
        ("MRAD", "rad", 0.036),
        ("MS", "s", 0.036),
        ("KPA", "Pa", 36e3),
        ("KM/H", "m/s", 10.0),
        ("M/S", "km/h", 129.6),
        ("M/S^2", "m/s^2", 36.0),
        ("NM", "N*m", 36.0),
        ("KN", "N", 36e3),
        ("DEG C", "K", 309.15),
        ("U/MIN", "rev/s", 0.6),
        # the unit of the signal decides
        ("MW", "MW", 36.0),
        ("MHZ", "MHz", 36.0),
    ],
)
def test_capitals_of_one_meaning_convert(
    tmp_path: Path, kind: str, stated: str, unit: str, first: float
) -> None:
    data = read(tmp_path, kind, stated, unit)
    assert data.series["v"][0] == pytest.approx(first, rel=1e-15)
    assert data.warnings == ()


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize(
    ("stated", "unit", "readings"),
    [
        ("ML/MIN", "L/min", ("ML/min", "mL/min")),
        ("MHZ", "Hz", ("mHz", "MHz")),
        ("MPA", "bar", ("mPa", "MPa")),
        ("MWH", "J", ("mWh", "MWh")),
        ("NM", "m", ("nm", "nmi")),
        # no millitonnes
        ("MT", "kg", ("Mt", "t")),
        ("MT/H", "kg/s", ("Mt/h", "t/h")),
    ],
)
def test_capitals_of_two_meanings_are_asked(
    tmp_path: Path, kind: str, stated: str, unit: str, readings: tuple[str, str]
) -> None:
    with pytest.raises(SpecError) as caught:
        read(tmp_path, kind, stated, unit)
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0512"
    first, second = readings
    assert f"unit: {first}}}}}`, or `unit: {second}`" in str(fault.help)
    # the advice
    for reading in readings:
        data = read(tmp_path, kind, stated, unit, f", unit: {reading}")
        expected = read(tmp_path, kind, reading, unit).series["v"]
        assert data.series["v"].tolist() == expected.tolist()


HEADERS: list[tuple[str, str | float]] = [
    # names alone say little: nobody counts volts in millions
    ("TIME,U [MV]", "E0512"),
    ("time,U [MV]", "E0512"),
    # units say more than names
    ("time [s],U [MV],x [km/h]", 36e6),
    ("TIME,U [MV],T [°C],x [km/h]", 36e6),
    ("Time,U [MV],Position [MM]", "E0512"),
    ("Time,U [MV],Torque [KNM]", "E0512"),
    ("Time,U [MV],Speed [RPM]", "E0512"),
    ("Time,U [MV],Speed [RPM],x [mm]", 36e6),
    ("Time,U [MV],x [km/h],Position [MM]", "E0512"),
]


@pytest.mark.parametrize(("header", "expected"), HEADERS)
def test_the_headers_of_a_file_show_whether_it_has_small_letters(
    tmp_path: Path, header: str, expected: str | float
) -> None:
    names = header.split(",")
    width = len(names)
    rows = "".join(f"{t!r},36{',0' * (width - 2)}\n" for t in TIME.tolist())
    (tmp_path / "a.csv").write_text(f"{header}\n{rows}")
    columns = {name: np.full(4, 36.0) for name in names}
    frame = pd.DataFrame(columns)
    frame.to_parquet(tmp_path / "a.parquet")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name in names:
            # `/` parts groups there
            label, _, unit = name.partition(" ")
            file[label] = np.full(4, 36.0)
            file[label].attrs["units"] = unit.strip("[]")
    with MDF(version="4.10") as file:
        for name in names:
            label, _, unit = name.partition(" ")
            # its own times are called `time`
            label = label.replace("time", "clock")
            file.append([Signal(np.full(4, 36.0), TIME, name=label, unit=unit.strip("[]"))])
        file.save(tmp_path / "a.mf4", overwrite=True)
    layout = "  columns: {v: U}\n"
    for name in ("a.csv", "a.parquet", "a.h5", "a.mf4"):
        assert outcome(partial(load, tmp_path, name, "V", layout)) == expected, name
    model = msnn.load(tmp_path / "car.msnn.yaml")
    section = model.spec.data
    assert section is not None
    for given in (frame, pl.DataFrame(columns)):
        data = partial(frame_data, model.program, section, given, section.place, {})
        assert outcome(data) == expected


def outcome(data: Callable[[], Dataset]) -> str | float:
    """The first value of `v`, or the code of the fault."""
    try:
        return float(data().series["v"][0])
    except SpecError as error:
        return error.diagnostics[0].code


@pytest.mark.parametrize(
    ("header", "unit", "expected"),
    [
        # power plants, presses: counted in millions where names show that there are small letters
        ("time,v [MW]", "W", 36e6),
        ("time,v [MN]", "N", 36e6),
        ("time,v [MJ]", "J", 36e6),
        ("time,v [MΩ]", "ohm", 36e6),
        ("TIME,v [MW]", "W", 36e6),
        ("TIME,V [MW]", "W", "E0512"),
        ("time,v [MA]", "A", "E0512"),
        ("time,v [MS]", "S", "E0512"),
        ("time,v [MH]", "H", "E0512"),
        ("time,v [ML]", "L", "E0512"),
    ],
)
def test_names_show_what_is_often_counted_in_millions(
    tmp_path: Path, header: str, unit: str, expected: str | float
) -> None:
    (tmp_path / "a.csv").write_text(f"{header}\n0,36\n0.1,37\n", "utf-8")
    column = header[5]
    found = outcome(partial(load, tmp_path, "a.csv", unit, f"  columns: {{v: {column}}}\n"))
    assert found == expected


def test_units_of_a_struct_show_whether_it_has_small_letters(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"u": V, "u_unit": "MV", "x": V, "x_unit": "MM"})
    with pytest.raises(SpecError, match="E0512"):
        load(tmp_path, "a.mat", "V", "  columns: {v: u}\n")
    savemat(tmp_path / "a.mat", {"u": V, "u_unit": "MV", "x": V, "x_unit": "mm"})
    assert load(tmp_path, "a.mat", "V", "  columns: {v: u}\n").series["v"][0] == 36e6


def test_a_unit_in_capitals_decides_between_two_fields(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["v [MV]"] = V
        file["v [MV]"].attrs["units"] = "mV"
    assert load(tmp_path, "a.h5", "V").series["v"][0] == 0.036
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["v [MV]"] = V
        file["v [MV]"].attrs["units"] = "kV"
    with pytest.raises(SpecError, match="E0991"):
        load(tmp_path, "a.h5", "V")


def test_a_line_of_units_in_capitals_is_one(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("TIME,v\nS,KM/H\n0,36\n0.1,37\n")
    data = load(tmp_path, "a.csv", "m/s", "  time: TIME\n")
    assert data.series["v"][0] == 10.0
    layout = "  time: TIME\n  columns: {v: U}\n"
    (tmp_path / "a.csv").write_text("TIME,U\nMS,MV\n0,36\n100,37\n")
    with pytest.raises(SpecError, match="E0512"):
        load(tmp_path, "a.csv", "V", layout)
    assert load(tmp_path, "a.csv", "mV", layout).series["v"].tolist() == [36.0, 37.0]


def test_capitals_beside_small_letters_are_asked_where_the_signal_has_the_other_unit(
    tmp_path: Path,
) -> None:
    (tmp_path / "a.csv").write_text("time,v [MV],x [mm]\n0,36,0\n0.1,37,0\n")
    assert load(tmp_path, "a.csv", "kV").series["v"][0] == 36e3
    with pytest.raises(SpecError, match="E0512"):
        load(tmp_path, "a.csv", "mV")


@pytest.mark.parametrize("text", ["PHZ", "PJ"])
def test_a_prefix_that_may_be_peta_is_not_read(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.csv").write_text(f"time,v [{text}]\n0,36\n0.1,37\n")
    unit = "Hz" if text == "PHZ" else "J"
    data = load(tmp_path, "a.csv", unit, '  time: time\n  columns: {v: "v [' + text + ']"}\n')
    assert [warning.code for warning in data.warnings] == ["W0511"]
