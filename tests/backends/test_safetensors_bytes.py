"""What is written is what the safetensors library reads, and always the same bytes."""

from __future__ import annotations

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import load

from backends.files.safetensors_bytes import safetensors_bytes

ARRAYS = {
    "β": np.array([[1.0, np.nan], [-0.0, 1e-310]]),
    "a.scalar": np.array(2.5),
    "none": np.zeros((0, 3)),
    "single": np.arange(3, dtype=np.float32),
    "count": np.array([2**62], dtype=np.int64),
    "turned": np.arange(6.0).reshape(2, 3).T,
}


def test_the_library_reads_every_bit() -> None:
    found = load(safetensors_bytes(ARRAYS, {"name": 'a "b" ρ'}))
    assert set(found) == set(ARRAYS)
    for name, value in ARRAYS.items():
        assert found[name].shape == value.shape
        assert found[name].tobytes() == value.tobytes(order="C")


def test_metadata_is_read(tmp_path) -> None:
    path = tmp_path / "x.safetensors"
    path.write_bytes(safetensors_bytes(ARRAYS, {"name": 'a "b" ρ', "unit": "m/s"}))
    with safe_open(path, framework="numpy") as file:
        assert file.metadata() == {"name": 'a "b" ρ', "unit": "m/s"}


def test_the_order_of_names_does_not_matter() -> None:
    turned = dict(reversed(ARRAYS.items()))
    first = safetensors_bytes(ARRAYS, {"a": "1", "b": "2"})
    assert first == safetensors_bytes(turned, {"b": "2", "a": "1"})


def test_another_dtype_is_refused() -> None:
    with pytest.raises(KeyError):
        safetensors_bytes({"x": np.zeros(2, np.complex128)}, {})
