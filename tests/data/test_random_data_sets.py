"""Random data sets are read as a reference reads them that is written row by row."""

from pathlib import Path

import pytest

from benchmarks.fuzz.data_files import UNITS
from benchmarks.fuzz.data_sets import trial
from msnn.data.formats.written_units import written_unit
from spec_schema.units.unit import Unit


def test_random_data_sets_are_read_as_the_reference_reads_them(tmp_path: Path) -> None:
    read = 0
    for seed in range(30):
        folder = tmp_path / str(seed)
        folder.mkdir()
        fault, is_read = trial(seed, folder)
        assert fault is None, (
            f"python -m benchmarks.fuzz.data_sets --first {seed} --count 1: {fault}"
        )
        read += is_read
    assert read > 10  # most are no refusals


def test_the_units_of_random_files_mean_what_their_factors_say() -> None:
    for name, units in UNITS.items():
        declared = written_unit(units[0][0])
        assert isinstance(declared, Unit)
        for text, factor, offset in units:
            unit = written_unit(text)
            assert isinstance(unit, Unit), f"{text} of {name} has several meanings"
            assert unit.scale * factor == pytest.approx(declared.scale, rel=1e-12)
            assert unit.offset == pytest.approx(-offset)
