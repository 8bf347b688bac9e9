"""Numbers that a file has packed are read as the attributes with them say, or refused by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest
from numpy.typing import NDArray

import msnn
from msnn.data.reading.frames import frame_data
from spec_schema.diagnostics.diagnostic import SpecError
from tests.data.unit_files import SPEC, TIME, load

PACKED = np.array([360, 370, -1, 2000], np.int16)
NAN = "  nan: split\n  time: time\n"
CASES: dict[str, tuple[dict[str, Any], list[float]]] = {
    "factor": ({"scale_factor": 0.1}, [36.0, 37.0, -0.1, 200.0]),
    "factor of 32 bits": ({"scale_factor": np.float32(0.1)}, [36.0, 37.0, -0.1, 200.0]),
    "summand": ({"add_offset": -300.0}, [60.0, 70.0, -301.0, 1700.0]),
    "both": ({"scale_factor": 0.1, "add_offset": 5.0}, [41.0, 42.0, 4.9, 205.0]),
    # fill values and limits are packed numbers
    "fill": ({"scale_factor": 0.1, "_FillValue": np.int16(-1)}, [36.0, 37.0, np.nan, 200.0]),
    "missing": ({"missing_value": [-1, 2000]}, [360.0, 370.0, np.nan, np.nan]),
    "minimum": ({"valid_min": 0}, [360.0, 370.0, np.nan, 2000.0]),
    "maximum": ({"valid_max": 1000, "scale_factor": 0.1}, [36.0, 37.0, -0.1, np.nan]),
    "range": ({"valid_range": [0, 1000]}, [360.0, 370.0, np.nan, np.nan]),
    "unsigned": ({"_Unsigned": "true"}, [360.0, 370.0, 65535.0, 2000.0]),
    "unit": ({"units": "km/h", "scale_factor": 0.1}, [10.0, 37 / 3.6, -0.1 / 3.6, 200 / 3.6]),
}


def write_hdf5(path: Path, values: NDArray[Any], attributes: dict[str, Any]) -> None:
    with h5py.File(path, "w") as file:
        file["time"], file["v"] = TIME, values
        for key, value in attributes.items():
            file["v"].attrs[key] = value


def write_mat(path: Path, values: NDArray[Any], attributes: dict[str, Any]) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        file["time"], file["v"] = TIME[None], values[None]
        for key, value in attributes.items():
            file["v"].attrs[key] = value


def write_parquet(path: Path, values: NDArray[Any], attributes: dict[str, Any]) -> None:
    texts = {key: str(value) for key, value in attributes.items()}
    column = arrow.field("v", arrow.from_numpy_dtype(values.dtype), metadata=texts)
    schema = arrow.schema([arrow.field("time", arrow.float64()), column])
    parquet.write_table(arrow.table([TIME, values], schema=schema), path)


WRITERS = {"a.h5": write_hdf5, "a.mat": write_mat, "a.parquet": write_parquet}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("case", CASES)
def test_packed_numbers_are_unpacked(tmp_path: Path, name: str, case: str) -> None:
    attributes, expected = CASES[case]
    WRITERS[name](tmp_path / name, PACKED, attributes)
    found = load(tmp_path, name, "m/s", NAN).series["v"]
    assert found == pytest.approx(np.array(expected), rel=1e-15, nan_ok=True)


@pytest.mark.parametrize("name", WRITERS)
def test_a_missing_number_of_an_input_is_reported(tmp_path: Path, name: str) -> None:
    WRITERS[name](tmp_path / name, PACKED, {"_FillValue": np.int16(-1)})
    with pytest.raises(SpecError, match="E0809"):
        load(tmp_path, name, "m/s", "  time: time\n")


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize(
    ("key", "value"),
    [("scale_factor", "big"), ("add_offset", [1.0, 2.0]), ("valid_range", [1, 2, 3])],
)
def test_an_attribute_that_nobody_can_apply_is_refused(
    tmp_path: Path, name: str, key: str, value: Any
) -> None:
    WRITERS[name](tmp_path / name, PACKED, {key: value})
    with pytest.raises(SpecError) as caught:
        load(tmp_path, name, "m/s", NAN)
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0840"
    assert f"`{key}`" in fault.message


def test_a_series_with_attributes_is_unpacked(tmp_path: Path) -> None:
    series = pd.Series(PACKED)
    series.attrs = {"units": "km/h", "scale_factor": 0.1, "valid_min": 0}
    spec = tmp_path / "car.msnn.yaml"
    spec.write_text(SPEC.replace("UNIT", "m/s").replace("FILE", "none.csv") + NAN)
    model = msnn.load(spec)
    assert model.spec.data is not None
    data = frame_data(
        model.program, model.spec.data, {"time": TIME, "v": series}, model.spec.data.place, {}
    )
    expected = np.array([10.0, 37 / 3.6, np.nan, 200 / 3.6])
    assert data.series["v"] == pytest.approx(expected, rel=1e-15, nan_ok=True)


@pytest.mark.parametrize("keeps_frame", [True, False])
@pytest.mark.parametrize(
    "attrs",
    [
        {"v": {"scale_factor": 0.1, "valid_min": 0}, "units": {"v": "km/h"}},
        {"scale_factor": {"v": 0.1}, "valid_min": {"v": 0}, "unit": {"v": "km/h"}},
    ],
)
def test_attributes_of_a_frame_unpack_its_columns(
    tmp_path: Path, attrs: dict[Any, Any], keeps_frame: bool
) -> None:
    frame = pd.DataFrame({"time": TIME, "v": PACKED})
    frame.attrs = attrs
    frame.to_parquet(tmp_path / "a.parquet")
    data = load(tmp_path, "a.parquet", "m/s", NAN)
    if keeps_frame:
        model = msnn.load(tmp_path / "car.msnn.yaml")
        section = model.spec.data
        assert section is not None
        data = frame_data(model.program, section, frame, section.place, {})
    expected = np.array([10.0, 37 / 3.6, np.nan, 200 / 3.6])
    assert data.series["v"] == pytest.approx(expected, rel=1e-15, nan_ok=True)


@pytest.mark.parametrize("dtype", ["f8", "f4", "i4", "u2", "i8"])
def test_what_netcdf_has_never_written_is_missing(tmp_path: Path, dtype: str) -> None:
    """The default fills of NetCDF, without an attribute: 9.96921e36 of floats."""
    fills = {"i4": -2147483647, "u2": 65535, "i8": -9223372036854775806}
    fill = fills.get(dtype, 9.969209968386869e36)
    for is_netcdf in (True, False):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file["time"] = TIME
            file["v"] = np.array([1, 0, fill, 4], dtype)
            if is_netcdf:
                file.attrs["_NCProperties"] = "version=2,netcdf=4.9.2"
        found = load(tmp_path, "a.h5", "m/s", NAN).series["v"]
        assert np.isnan(found).tolist() == [False, False, is_netcdf, False]


def test_times_are_unpacked(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"], file["v"] = np.arange(4, dtype=np.int32), PACKED
        file["time"].attrs["units"] = "ms"
        file["time"].attrs["scale_factor"] = 100.0
    assert load(tmp_path, "a.h5", "m/s", NAN).episodes("train").tolist() == [[0, 4]]


@pytest.mark.parametrize(
    ("first", "second", "code"),
    [
        ("km/h", "m/s", "E0991"),
        ("km/h", "kph", None),
        ("furlong", "km/h", None),
        ("", "km/h", None),
    ],
)
@pytest.mark.parametrize("name", WRITERS)
def test_two_fields_of_units_that_differ_are_asked(
    tmp_path: Path, name: str, first: str, second: str, code: str | None
) -> None:
    for attributes in ({"unit": first, "units": second}, {"Unit": second, "units": first}):
        WRITERS[name](tmp_path / name, PACKED, attributes)
        if code is None:
            assert load(tmp_path, name, "m/s", NAN).series["v"][0] == pytest.approx(100)
            continue
        with pytest.raises(SpecError, match=code):
            load(tmp_path, name, "m/s", NAN)


def test_a_text_beside_an_attribute_of_another_unit_is_asked(tmp_path: Path) -> None:
    write_hdf5(tmp_path / "a.h5", PACKED, {"units": "km/h"})
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["v_unit"] = "m/s"
    with pytest.raises(SpecError, match="E0991"):
        load(tmp_path, "a.h5", "m/s", NAN)


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize(
    ("attributes", "said", "first", "codes"),
    [
        ({"scale_factor": 0.1}, "scale: 0.1", 3.6, ["W0835"]),
        ({"scale_factor": 0.1, "units": "m/s"}, "scale: 2", 72.0, ["W0835"]),
        ({"add_offset": 5.0}, "offset: 5", 370.0, ["W0835"]),
        ({"scale_factor": 0.1}, "scale: 0.1, unit: km/h", 1.0, ["W0835"]),
        # one factor alone
        ({"scale_factor": 0.1}, "unit: km/h", 10.0, []),
        ({"scale_factor": 1.0, "add_offset": 0.0}, "scale: 0.1", 36.0, []),
        ({"_FillValue": -1}, "scale: 0.1", 36.0, []),
    ],
)
def test_a_factor_of_the_spec_beside_one_of_the_file_is_reported(
    tmp_path: Path,
    name: str,
    attributes: dict[str, Any],
    said: str,
    first: float,
    codes: list[str],
) -> None:
    WRITERS[name](tmp_path / name, PACKED, attributes)
    layout = f"{NAN}  columns: {{v: {{column: v, {said}}}}}\n"
    data = load(tmp_path, name, "m/s", layout)
    assert data.series["v"][0] == pytest.approx(first, rel=1e-15)
    assert [warning.code for warning in data.warnings] == codes
