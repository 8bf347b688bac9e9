"""Compares changed copies of a function with the original at every float, or at random
arguments.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.mutation.math_functions import Function

Point = tuple[float, float]
"""An argument of a function of one is the first of them."""

_FLAGS = ("-std=c11", "-O3", "-march=native", "-ffp-contract=off", "-fno-math-errno", "-w")
_CONSTANT = re.compile(r"(?<![\w.])(?:0x[0-9a-f.]+p[-+]\d+|\d+\.\d*(?:e[-+]?\d+)?)(?=f?\b)")
_STATEMENT = re.compile(
    r"if \((?P<condition>[^;{}]*)\) \{"
    r"|(?<=\n) +static const (?:\w+_PLACED )?\w+ (?P<table>\w+)[^;]*;"
    r"|(?<=\n) +(?:const \w+ )?\*?\w+ = (?P<value>[^;{}]*);"
)
"""One that a constant can be in."""
_WORDS = {"float": ("uint32_t", "0x7FC00000U"), "double": ("uint64_t", "0x7FF8000000000000U")}
"""What has as many bits, and the one NaN."""
_ALWAYS = (0.0, 5e-324, 1e-45, 0.5, 1.0, 2.0, 3.0, float("inf"), float("nan"))
"""Corners of every function."""


def first_shown(
    name: str,
    right: Mapping[str, Function],
    changed: Sequence[Mapping[str, Function]],
    arguments: Sequence[str],
    further: Collection[float] = (),
) -> Iterator[tuple[int, Point]]:
    """Yields the changed functions that differ from the original, each with one argument that shows
    it.

    Zeros differ by their signs; all NaNs are equal. `further` are additional numbers to try.
    """
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        text = _changes(name, right, changed, further)
        (folder / "changes.h").write_text(text, encoding="utf-8")
        program, main = folder / "program", Path(__file__).with_suffix(".c")
        command = ["gcc", *_FLAGS, f"-I{folder}", main, "-o", program, "-lm"]
        subprocess.run(command, check=True)
        done = subprocess.run([program, *arguments], check=True, capture_output=True, text=True)
    for line in done.stdout.splitlines():
        number, *point = line.split()
        first, second = map(float.fromhex, point)
        yield int(number), (first, second)


def _changes(
    name: str,
    right: Mapping[str, Function],
    changed: Sequence[Mapping[str, Function]],
    further: Collection[float],
) -> str:
    function = right[name]
    real = function.arguments[0].split()[0]
    word, nan = _WORDS[real]
    corners = _corners(right, real, further)
    given = [_literal(one, real) for one in (further or (1.0,))]
    numbers = range(len(changed))
    return "\n".join(
        (
            *(f"#include <{one}.h>" for one in ("float", "math", "stdbool", "stdint", "string")),
            f"typedef {real} real;\ntypedef {word} word;",
            f"enum {{ ARITY = {len(function.arguments)} }};",
            f"enum {{ RESULTS = {len(function.written) or 1} }};",
            f"enum {{ BLOCK = 4096, CORNERS = {len(corners)}, CHANGES = {len(changed)} }};",
            f"static const real corners[] = {{{', '.join(corners)}}};",
            f"enum {{ GIVEN = {len(given)} }};",
            f"static const real given[] = {{{', '.join(given)}}};",
            "static uint8_t noted[CHANGES];\nstatic real x[BLOCK], y[BLOCK];",
            "static word right[RESULTS][BLOCK];",
            "static inline word bits(real value)\n{",
            "    word pattern;\n    memcpy(&pattern, &value, sizeof pattern);",
            f"    return (value != value) ? {nan} : pattern;\n}}",
            "static inline uint64_t whole(uint64_t value)\n{\n    return value;\n}",
            "#define PATTERN(value) _Generic((value), real: bits, default: whole)(value)",
            "#define NOTE(at, right, changed) noted[at] |= (PATTERN(right) != PATTERN(changed))",
            *_instrumented(right, changed),
            *(_copies(number, right, one) for number, one in enumerate(changed)),
            "static void take_right(void)\n{\n    for (int i = 0; i < BLOCK; i++) {",
            _called(function, function.name, "right[{at}][i] = {value};"),
            "    }\n}",
            *(_differs(function, number) for number in numbers),
            f"static word (*const differs_at[])(int) = {{{_each('differs_at_', numbers)}}};",
            f"static bool (*const differs[])(void) = {{{_each('differs_', numbers)}}};",
        )
    )


def _each(begin: str, numbers: range) -> str:
    return ", ".join(f"{begin}{number}" for number in numbers)


def _corners(right: Mapping[str, Function], real: str, further: Collection[float]) -> list[str]:
    """The constants of the functions and their neighbouring floats, of both signs."""
    dtype = np.float32 if real == "float" else np.float64
    texts = (text for each in right.values() for text in _CONSTANT.findall(each.text))
    found = [float.fromhex(text) if "x" in text else float(text) for text in texts]
    with np.errstate(over="ignore", under="ignore"):
        middle = np.array([*found, *further, *_ALWAYS], dtype)
        around = [middle, *(np.nextafter(middle, dtype(end)) for end in (-np.inf, np.inf))]
        every = np.concatenate([*around, *(-one for one in around)])
    ordered = sorted({float(one) for one in every if one == one})
    return [_literal(one, real) for one in (*ordered, float("-0.0"), float("nan"))]


def _literal(number: float, real: str) -> str:
    if number != number:
        return "NAN"
    named = {np.inf: "INFINITY", -np.inf: "-INFINITY"}
    return named.get(number) or f"{number.hex()}{'f' * (real == 'float')}"


def _instrumented(
    right: Mapping[str, Function], changed: Sequence[Mapping[str, Function]]
) -> Iterator[str]:
    """C code of the functions, which records for each change if its statement computes another
    value.
    """
    for name, function in right.items():
        own = [(number, one[name].text) for number, one in enumerate(changed)]
        notes = [
            _note(number, function.text, text) for number, text in own if text != function.text
        ]
        text = function.text
        for place, note in sorted(notes, reverse=True):
            text = text[:place] + note + text[place:]
        yield text if text.startswith("static ") else f"static {text}"


def _note(number: int, right: str, changed: str) -> tuple[int, str]:
    """The position in the original text at which a change is recorded, and the code that
    does it.
    """
    at = next(
        at for at, (one, other) in enumerate(zip(right, changed, strict=False)) if one != other
    )
    (found,) = (s for s in _STATEMENT.finditer(right) if s.start() <= at < s.end())
    end = found.end() + len(changed) - len(right)
    other = _STATEMENT.match(changed, found.start(), end)
    assert other is not None
    if found["condition"] is not None:
        differ = f"NOTE({number}, {found['condition']}, {other['condition']})"
        return found.start("condition"), f"{differ}, "
    if found["value"] is not None:
        return found.end(), f" NOTE({number}, {found['value']}, {other['value']});"
    reads = [*re.finditer(rf" = {found['table']}\[([^\[\];]*)\];", right)]
    if len(reads) == 1 and right.count(f"{found['table']}[") == 2:
        entry = right[found.start() : at].count(",")
        return reads[0].end(), f" noted[{number}] |= (({reads[0][1]}) == {entry}U);"
    return found.end(), f" noted[{number}] = 1U;"


def _copies(number: int, right: Mapping[str, Function], changed: Mapping[str, Function]) -> str:
    """C code of the changed function and those that call it, with names of their own."""
    copied = dict[str, str]()
    for name, function in changed.items():
        called = [one for one in copied if function.calls(one)]
        if called or function.text != right[name].text:
            text = function.text
            for one in (*called, name):
                text = re.sub(rf"\b{one}\(", f"{one}_{number}(", text)
            copied[name] = text if text.startswith("static ") else f"static {text}"
    return "".join(copied.values())


def _called(function: Function, name: str, use: str) -> str:
    """C code that calls a function for argument i, and uses the bits of each result."""
    given = ["x[i]", "y[i]"][: len(function.arguments)]
    if not function.written:
        value = f"bits({name}({', '.join(given)}))"
        return f"        {use.format(at=0, value=value)}"
    kinds = [one.split()[0] for one in function.written]
    results = [f"result_{at}" for at in range(len(kinds))]
    declared = " ".join(f"{kind} {one};" for kind, one in zip(kinds, results, strict=True))
    call = f"{name}({', '.join((*given, *(f'&{one}' for one in results)))});"
    used = (
        use.format(at=at, value=one if kind.startswith("uint") else f"bits({one})")
        for at, (kind, one) in enumerate(zip(kinds, results, strict=True))
    )
    return f"        {declared}\n        {call}\n        {' '.join(used)}"


def _differs(function: Function, number: int) -> str:
    called = _called(function, f"{function.name}_{number}", "differ |= {value} ^ right[{at}][i];")
    return (
        f"static inline word differs_at_{number}(int i)\n{{\n    word differ = 0U;\n{called}\n"
        f"    return differ;\n}}\nstatic bool differs_{number}(void)\n{{\n    word differ = 0U;\n"
        f"    for (int i = 0; i < BLOCK; i++) {{\n        differ |= differs_at_{number}(i);\n"
        "    }\n    return differ != 0U;\n}\n"
    )
