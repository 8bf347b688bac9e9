"""Spoils the text of a spec in the ways that people and programs do, from a seed."""

from __future__ import annotations

import random
import re
from collections.abc import Callable

_TOKEN = re.compile(r"\w+|[^\w\s]|\n *| +")
_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")
_NAME = re.compile(r"[^\W\d]\w*")

NUMBERS = (
    *("0", "-1", "1", "0.5", "1e308", "1e400", "-1e-400", "99999999999999999999", "010", "1_0"),
    *(".inf", "-.inf", ".nan", "1e9", "2147483648", "0x10", "12:30:45", "1 s", "3 m", "true"),
)
SNIPPETS = (
    *("t", "dt", "pi", "x[t]", "x[t+1]", "x[t-1:t]", "x.past(3)", "x.future(1 s)", "x.meas", "y"),
    *("integral(x)", "der(x)", "der(x, method=central)", "grad(y, x)", "grad(x, x)", "next(x)"),
    *(
        "flow(x)",
        "sum(x, over=t)",
        "stack(x, 1)",
        "concat(x, x)",
        "part(x, 0)",
        "where(x > 0, 1, x)",
    ),
    *("linspace(0, 1, 3)", "arange(0, 0)", "ones(0)", "eye(2)", "x @ x", "[1, 2]", "[]", "[x, x]"),
    *("mse(x, y)", "mse(x)", "cross_entropy(x, x)", "log(0 * x)", "1 / 0", "2 ** 0.5", "x ** 99"),
    *("outer(x, x)", "max(x, x)", "clip(x, 1, 0)", "min()", "lambda: x", "x if x else x", "__x__"),
    *("x[t:t][t-1]", "x[0]", "x[t+x]", "'x'", '"x"', "x.y.z", "**x", "*x", "x := 1", "{x: 1}"),
    *(
        "{}",
        "[[1], [2, 3]]",
        "null",
        "~",
        "no",
        "!tag x",
        "&a [*a]",
        "*a",
        "<<: *a",
        "- - -",
        "? x",
    ),
    *("|", ">", "|-\n  x", "#", "---", "...", "%YAML 1.1", "@x", "`x`", "!", "?", ":", ",", "\t"),
    *("é", "Ω", "µ", "Ｘ", "x\u0301", "\u200b", "\u202e", "\ufeff", "\x00", "\x85", "\u2028", "🚗"),
    *("\r", "\r\n", "\x1b[31m", "\\", "\ud7ff", "\U0010ffff", "for", "int", "double", "lambda"),
    *("{fir: {window: 3}}", "{der: x, next: x}", "{init: x, history: x}", "{dims: [o, o]}"),
    *("{predicts: x[t-1]}", "{normal: {}}", "{file: k.csv}", "{linspace: [0, 1, 0]}"),
)

Mutation = Callable[[random.Random, str], str]


def spoiled(seed: int, specs: tuple[str, ...]) -> str:
    """One of the specs after a few mutations, the same for the same seed."""
    chance = random.Random(seed)
    text = chance.choice(specs)
    for _ in range(chance.choice((1, 1, 1, 2, 3, 5, 8))):
        text = chance.choice(_MUTATIONS)(chance, text)
    return text


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True) or [""]


def _delete_line(chance: random.Random, text: str) -> str:
    lines = _lines(text)
    del lines[chance.randrange(len(lines))]
    return "".join(lines)


def _repeat_line(chance: random.Random, text: str) -> str:
    lines = _lines(text)
    line = chance.choice(lines)
    lines.insert(chance.randrange(len(lines)), line)
    return "".join(lines)


def _swap_lines(chance: random.Random, text: str) -> str:
    lines = _lines(text)
    i, j = chance.randrange(len(lines)), chance.randrange(len(lines))
    lines[i], lines[j] = lines[j], lines[i]
    return "".join(lines)


def _indent_line(chance: random.Random, text: str) -> str:
    lines = _lines(text)
    i = chance.randrange(len(lines))
    lines[i] = (
        chance.choice((" ", "  ", "\t")) + lines[i] if chance.random() < 0.5 else lines[i][1:]
    )
    return "".join(lines)


def _token(change: Callable[[random.Random, list[str], int], None]) -> Mutation:
    def mutate(chance: random.Random, text: str) -> str:
        tokens = _TOKEN.findall(text) or [""]
        change(chance, tokens, chance.randrange(len(tokens)))
        return "".join(tokens)

    return mutate


def _delete(chance: random.Random, tokens: list[str], i: int) -> None:
    del chance, tokens[i]


def _repeat(chance: random.Random, tokens: list[str], i: int) -> None:
    tokens[i] *= chance.choice((2, 2, 3, 300))


def _exchange(chance: random.Random, tokens: list[str], i: int) -> None:
    j = chance.randrange(len(tokens))
    tokens[i], tokens[j] = tokens[j], tokens[i]


def _insert(chance: random.Random, tokens: list[str], i: int) -> None:
    tokens.insert(i, chance.choice(SNIPPETS))


def _replace(chance: random.Random, tokens: list[str], i: int) -> None:
    tokens[i] = chance.choice(SNIPPETS)


def _of(pattern: re.Pattern[str], values: Callable[[random.Random, str], str]) -> Mutation:
    def mutate(chance: random.Random, text: str) -> str:
        found = list(pattern.finditer(text))
        if not found:
            return text
        place = chance.choice(found)
        return text[: place.start()] + values(chance, text) + text[place.end() :]

    return mutate


def _any_name(chance: random.Random, text: str) -> str:
    return chance.choice(_NAME.findall(text))


def _nested(chance: random.Random, text: str) -> str:
    depth = chance.choice((3, 60, 70, 200, 2000))
    opening, closing = chance.choice(
        (("(", ")"), ("[", "]"), ("{a: ", "}"), ("-", ""), ("sin(", ")"))
    )
    place = chance.randrange(len(text) + 1)
    return text[:place] + opening * depth + "x" + closing * depth + text[place:]


def _cut(chance: random.Random, text: str) -> str:
    return text[: chance.randrange(len(text) + 1)]


def _character(chance: random.Random, text: str) -> str:
    place = chance.randrange(len(text) + 1)
    return (
        text[:place]
        + chr(chance.choice((chance.randrange(128), chance.randrange(0xD800))))
        + text[place + 1 :]
    )


def _line_ends(chance: random.Random, text: str) -> str:
    return text.replace("\n", chance.choice(("\r\n", "\r", "\n\n")))


_MUTATIONS: tuple[Mutation, ...] = (
    *(_delete_line, _repeat_line, _swap_lines, _indent_line),
    *(_token(_delete), _token(_repeat), _token(_exchange), _token(_insert), _token(_replace)),
    *(_token(_insert), _token(_replace)),
    _of(_NUMBER, lambda chance, _: chance.choice(NUMBERS)),
    _of(_NAME, _any_name),
    _of(_NAME, _any_name),
    _of(_NAME, lambda chance, _: chance.choice(SNIPPETS)),
    *(_nested, _cut, _character, _line_ends),
)
