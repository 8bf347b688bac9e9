"""Rule R12 of weight files: names, shapes, units, and files that are no weights."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from safetensors import safe_open
from safetensors.numpy import save_file

from msnn.model.weights.weights_file import initial_weights, read_weights, write_weights
from spec_schema.diagnostics.diagnostic import SpecError
from tests.backends.test_atomic_write import waits_for_disk
from tests.programs import fir_closed_loop, spring_damper_rk4


def test_weights_come_back_with_every_bit(tmp_path: Path) -> None:
    program = fir_closed_loop().program
    weights = {"h.weight": np.arange(5) / 3, "g.weight": np.array([np.pi])}
    loaded = read_weights(write_weights(tmp_path / "w.safetensors", weights, program), program)
    for name, value in weights.items():
        np.testing.assert_array_equal(loaded[name], value)


def test_the_file_names_its_spec_and_the_units(tmp_path: Path) -> None:
    program = spring_damper_rk4().program
    path = write_weights(tmp_path / "w.safetensors", initial_weights(program), program)
    with safe_open(path, framework="numpy") as file:
        metadata = file.metadata()
    assert metadata["program"] == "spring_damper_rk4"
    assert '"stiffness": "N/m"' in metadata["units"]


def test_weights_wait_for_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program, path = fir_closed_loop().program, tmp_path / "w.safetensors"
    found = waits_for_disk(monkeypatch, path)
    write_weights(path, initial_weights(program), program)
    assert found == [("file", b""), ("folder", path.read_bytes())]
    # of a run whose log says the rest: the content waits, the name does not
    write_weights(path, initial_weights(program), program, named_later=True)
    assert [kind for kind, _ in found[2:]] == ["file"]


def test_missing_names_and_wrong_shapes_are_errors(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    save_file({"h.weight": np.zeros((5, 1))}, path)
    with pytest.raises(SpecError) as caught:
        read_weights(path, fir_closed_loop().program)
    assert [d.code for d in caught.value.diagnostics] == ["E0911", "E0912"]
    assert "shape 5×1, not 5" in caught.value.diagnostics[1].message


def test_unknown_names_are_an_error(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    save_file({"h.weight": np.zeros(5), "g.weight": np.zeros(1), "old": np.zeros(2)}, path)
    with pytest.raises(SpecError, match=r"E0959.* has `old`, which the model does not have"):
        read_weights(path, fir_closed_loop().program)


@pytest.mark.parametrize("content", [b"not weights", b"\xff" * 64])
def test_a_file_of_another_kind_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    path.write_bytes(content)
    with pytest.raises(SpecError, match="not a safetensors file"):
        read_weights(path, fir_closed_loop().program)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="cannot read the weights"):
        read_weights(tmp_path / "none.safetensors", fir_closed_loop().program)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_not_finite_are_refused(value: float, tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    save_file({"h.weight": np.full(5, value), "g.weight": np.zeros(1)}, path)
    with pytest.raises(SpecError, match=r"not finite in `h\.weight`"):
        read_weights(path, fir_closed_loop().program)


@pytest.mark.parametrize("kind", [np.int64, np.bool_])
def test_arrays_that_are_no_floating_point_numbers_are_refused(kind: type, tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    save_file({"h.weight": np.zeros(5, kind), "g.weight": np.zeros(1)}, path)
    with pytest.raises(SpecError, match=r"`h\.weight` in .* not floating point numbers"):
        read_weights(path, fir_closed_loop().program)


def _damaged(content: bytes) -> dict[str, tuple[bytes, str]]:
    """Bytes that are no weights, with what is said of each."""
    header = 8 + int.from_bytes(content[:8], "little")
    halves = b'{"a": {"dtype": "BF16", "shape": [1], "data_offsets": [0, 2]}}'
    other = content[8:header].replace(b'"shape":[5]', b'"shape":[6]')
    return {
        "empty": (b"", "it is empty"),
        "of text": (b"these are no weights", "it is not a safetensors file"),
        "a pointer": (b"version https://git-lfs.github.com/spec/v1\noid", "`git lfs pull`"),
        "of torch": (b"PK\x03\x04" + bytes(60), "a zip archive, as torch.save"),
        "half a header": (content[: header - 5], f"cut off in its header: {header:,} bytes of"),
        "half its arrays": (content[:-5], f"need {len(content):,} bytes, it has"),
        "more than its arrays": (content + b"123", "3 bytes follow its last array"),
        "a broken header": (content[:8] + b"{" * (header - 8) + content[header:], "is damaged"),
        "another shape": (content[:8] + other + content[header:], "do not fit"),
        "half precision": (
            len(halves).to_bytes(8, "little") + halves + b"\x00\x00",
            "`a` has the dtype BF16, of which numpy has none",
        ),
    }


@pytest.mark.parametrize("fault", _damaged(bytes(8)).keys())
def test_each_fault_of_a_weights_file_has_its_reason(fault: str, tmp_path: Path) -> None:
    program = fir_closed_loop().program
    path = write_weights(tmp_path / "w.safetensors", initial_weights(program), program)
    content, reason = _damaged(path.read_bytes())[fault]
    path.write_bytes(content)
    with pytest.raises(SpecError) as caught:
        read_weights(path, program)
    (found,) = caught.value.diagnostics
    assert reason in found.message
    assert "Error" not in found.message
