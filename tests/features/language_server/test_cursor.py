"""A place is found in texts that are no YAML yet."""

from __future__ import annotations

import pytest

from msnn.features.language_server.cursor import Cursor, cursor_at
from tests.features.language_server.marked import unmarked

_VALUE, _KEY = False, True


@pytest.mark.parametrize(
    ("text", "path", "is_key", "before"),
    [
        ("na|", (), _KEY, "na"),
        ("sample_time: 10 |", ("sample_time",), _VALUE, "10 "),
        ("inputs:\n  F: {unit: N|", ("inputs", "F", "unit"), _VALUE, "N"),
        ("inputs:\n  F: {doc: driver's, un|", ("inputs", "F"), _KEY, "un"),
        ("inputs:\n  F: {doc: 'a, b', un|}", ("inputs", "F"), _KEY, "un"),
        ("inputs:\n  F: {dims: [a, b|]}", ("inputs", "F", "dims", "0"), _VALUE, "b"),
        ("inputs:\n  F: {\n    unit: m,\n    |", ("inputs", "F"), _KEY, ""),
        ("inputs:\n  F: {unit: m}\n  |", ("inputs",), _KEY, ""),
        ("inputs:\n  F:\n    unit: m\n    d|", ("inputs", "F"), _KEY, "d"),
        ("inputs:\n  F:\n    unit: m\n|", (), _KEY, ""),
        ("equations:\n  a: k * x[t-|", ("equations", "a"), _VALUE, "k * x[t-"),
        ("equations:\n  # why\n\n  a: k * (|", ("equations", "a"), _VALUE, "k * ("),
        ("equations:\n  a: >-\n    k *\n    ma|", ("equations", "a"), _VALUE, "ma"),
        ("equations:\n  a:\n    ex|", ("equations", "a"), _KEY, "ex"),
        ('equations:\n  a: "k *|"', ("equations", "a"), _VALUE, "k *"),
        ("train:\n  - epochs: 3\n    opt|", ("train", "0"), _KEY, "opt"),
        ("train:\n- epochs: 3\n  opt|", ("train", "0"), _KEY, "opt"),
        ("train:\n- epochs: 3\n- opt|", ("train", "0"), _KEY, "opt"),
        ("train:\n- |", ("train", "0"), _KEY, ""),
        ("train:\n  - {rollout: {hor|", ("train", "0", "rollout"), _KEY, "hor"),
        ("export:\n  c: {close: a}\n  o|", ("export",), _KEY, "o"),
        ("{name: m, in|", (), _KEY, "in"),
        ("|", (), _KEY, ""),
    ],
)
def test_place_in_a_text(text: str, path: tuple[str, ...], is_key: bool, before: str):
    source, position = unmarked(text)
    found = cursor_at(source, position.line, position.character)
    assert found == Cursor(path, is_key, before)
