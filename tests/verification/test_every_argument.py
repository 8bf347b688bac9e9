"""Changed last digits of mathematical functions: what an argument shows, and what none does."""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.mutation.every_argument import first_shown
from benchmarks.mutation.math_functions import Function, functions_of, needed, text_hash
from msnn.verification.proof_step import GCC
from tests.conditions import miss

_SOURCE = """\
static float own_inner(float x)
{
    float result;
    if (x < 1.0f) {
        result = x * 0.25f;
    } else {
        result = (x + 0x1p+30f) - 0x1p+30f;
    }
    return result;
}

float own_outer(float x)
{
    const float size = fabsf(x);
    return own_inner(size);
}
"""


def test_a_change_that_one_float_shows_is_found_there() -> None:
    """Only the float at a limit tells that it moved."""
    moved = _SOURCE.replace("x < 1.0f", "x < 0x1.fffffep-1f")
    slope = _SOURCE.replace("0.25f", "0x1.000002p-2f")
    point, other = _found("own_outer", [moved, slope])
    assert point is not None
    assert abs(point) == 0.9999999403953552
    assert other is not None


def test_a_change_that_no_float_shows_is_not() -> None:
    """A size of 0 or more stays as it is where 0 is added, and so does a sum."""
    signed = _SOURCE.replace("result = x * 0.25f;", "result = (x * 0.25f) + 0.0f;")
    added = _SOURCE.replace("x + 0x1p+30f", "x + 0x1p+30f + 0.0f")
    assert _found("own_outer", [signed, added]) == [None, None]


def test_an_entry_of_a_table_shows_where_it_is_read() -> None:
    """The last entry never is."""
    source = """\
float own_power(float x)
{
    static const float powers[3] = {
        0x1p+0f, 0x1p+1f, 0x1p+2f
    };
    const uint32_t place = (x < 0x1p-130f) ? 0U : 1U;
    const float power = powers[place];
    return power;
}
"""
    entries = ("0x1p+0f", "0x1p+1f", "0x1p+2f")
    changed = [source.replace(entry, "0x1.8p+0f") for entry in entries]
    first, second, last = _found("own_power", changed, source)
    assert first is not None
    assert first < 2.0**-130
    assert second is not None
    assert second >= 2.0**-130
    assert last is None


def test_corners_outside_of_what_callers_give_are_not_tried() -> None:
    """A size is no negative number; what would show there alone does not show."""
    source = """\
float own_size(float x)
{
    const float least = (x < 0.0f) ? -1.0f : 0.0f;
    return x + least;
}
"""
    changed = [source.replace("-1.0f", "-2.0f"), source.replace(": 0.0f", ": 0.5f")]
    right = needed(functions_of(source), "own_size")
    every: list[Mapping[str, Function]] = [needed(functions_of(c), "own_size") for c in changed]
    sizes = ("corners", "0", str(0x7F7FFFFF))
    assert {*dict(first_shown("own_size", right, every, sizes))} == {1}


def test_a_pair_is_found_beside_the_place_where_the_function_inside_differs() -> None:
    """One size of x tells, beside few y, none of them a constant's neighbour."""
    source = """\
static float own_inner(float x)
{
    const float part = ((x * x) < 0x1.4b66ccp+10f) ? 1.0f : 2.0f;
    return part;
}

float own_outer(float x, float y)
{
    const float part = own_inner(x);
    const float square = y * y;
    const float seen = ((square > 1.9f) && (square < 2.0f)) ? part : 0.0f;
    return seen;
}
"""
    moved = source.replace("0x1.4b66ccp+10f", "0x1.4b66cep+10f")
    assert moved != source
    right = needed(functions_of(source), "own_outer")
    changed: list[Mapping[str, Function]] = [needed(functions_of(moved), "own_outer")]
    beside = ("beside", "4", "-12", "12", "-12", "12")
    given = (float.fromhex("0x1.23456p+5"),)
    drawn = ("drawn", *beside[1:])
    assert not [*first_shown("own_outer", right, changed, drawn)]
    (found,) = first_shown("own_outer", right, changed, beside, given)
    assert abs(found[1][0]) == given[0]


def test_texts_are_the_same_wherever_their_lines_break() -> None:
    right = functions_of(_SOURCE)
    broken = functions_of(
        _SOURCE.replace("own_", "cart_pole_").replace(" - ", "\n    - "), "cart_pole"
    )
    assert text_hash(right, right) == text_hash(broken, broken)
    other = functions_of(_SOURCE.replace("0.25f", "0.26f"))
    assert text_hash(right, right) != text_hash(right, other)


def _found(name: str, changed: list[str], source: str = _SOURCE) -> list[float | None]:
    if not GCC.is_there:
        miss(f"gcc is not installed: apt-get install {GCC.package}")
    right = needed(functions_of(source), name)
    every: list[Mapping[str, Function]] = [needed(functions_of(c), name) for c in changed]
    points: dict[int, tuple[float, float]] = {}
    # all corners, then a million floats from 0.9375 on
    for arguments in (("corners", "0", str(2**32 - 1)), ("every", "1064304640", "1065353216")):
        points = dict(first_shown(name, right, every, arguments)) | points
    return [points[n][0] if n in points else None for n in range(len(changed))]
