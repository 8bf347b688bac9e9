"""Writes compiler/kernels/tables/coefficients.py: every number that the kernels are built from.

    python benchmarks/kernel_accuracy/fit_coefficients.py

Prints the largest relative error of each polynomial on its interval, as a power of two. Needs
mpmath; takes about a minute.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from pathlib import Path

from minimax import fit, round_to
from mpmath import mp, mpf

TARGET = Path(__file__).parents[2] / "compiler" / "kernels" / "tables" / "coefficients.py"
SMALLEST = mpf(2) ** -60  # stands for 0 where a formula divides by its argument
QUARTER_TURN = mp.pi / 4

mp.dps = 120


def odd(function: Callable[[mpf], mpf]) -> Callable[[mpf], mpf]:
    """P of f(x) = x + x·z·P(z), z = x²."""
    return lambda z: (function(mp.sqrt(z)) / mp.sqrt(z) - 1) / z


def odd_weight(function: Callable[[mpf], mpf]) -> Callable[[mpf], mpf]:
    return lambda z: mp.sqrt(z) * z / function(mp.sqrt(z))


def ratio_logarithm(z: mpf) -> mpf:
    """(log((1+s)/(1−s)) − 2s)/(s·z), z = s²."""
    s = mp.sqrt(z)
    return (mp.log((1 + s) / (1 - s)) - 2 * s) / (s * z)


# name: (target, weight, low, high or that of float and of double, degree for float, for double)
FITS = {
    # e^r = 1 + r + r²·P(r)
    "EXPONENTIAL": (
        lambda r: (mp.exp(r) - 1 - r) / r**2,
        lambda r: r**2 / mp.exp(r),
        -mp.log(2) / 2 * mpf("1.001"),
        mp.log(2) / 2 * mpf("1.001"),
        4,
        9,
    ),
    # log((1+s)/(1−s)) = 2s + s·z·P(z)
    "LOGARITHM": (
        ratio_logarithm,
        lambda z: z,
        SMALLEST,
        (mp.sqrt(2) - 1) ** 2 / (mp.sqrt(2) + 1) ** 2 * mpf("1.001"),
        3,
        6,
    ),
    # log((1+s)/(1−s)) = 2s + s·(2/3·z + z²·P(z))
    "LOGARITHM_TAIL": (
        lambda z: (ratio_logarithm(z) - mpf(2) / 3) / z,
        lambda z: z**2,
        SMALLEST,
        (mp.sqrt(2) - 1) ** 2 / (mp.sqrt(2) + 1) ** 2 * mpf("1.001"),
        3,
        8,
    ),
    "SINE": (odd(mp.sin), odd_weight(mp.sin), SMALLEST, QUARTER_TURN**2 * mpf("1.001"), 2, 5),
    # cos r = 1 − z/2 + z²·P(z)
    "COSINE": (
        lambda z: (mp.cos(mp.sqrt(z)) - 1 + z / 2) / z**2,
        lambda z: z**2,
        SMALLEST,
        QUARTER_TURN**2 * mpf("1.001"),
        2,
        5,
    ),
    "TANGENT": (odd(mp.tan), odd_weight(mp.tan), SMALLEST, QUARTER_TURN**2 * mpf("1.001"), 6, 14),
    "ARC_SINE": (odd(mp.asin), odd_weight(mp.asin), SMALLEST, mpf("0.2501"), 4, 12),
    "ARC_TANGENT": (
        odd(mp.atan), odd_weight(mp.atan), SMALLEST, mpf(7) ** 2 / 256 * mpf("1.001"), 4, 10,
    ),
    "HYPERBOLIC_SINE": (odd(mp.sinh), odd_weight(mp.sinh), SMALLEST, mpf("1.001"), 3, 6),
    "HYPERBOLIC_TANGENT": (
        odd(mp.tanh), odd_weight(mp.tanh), SMALLEST, (mpf("0.95") ** 2, mpf("0.3026")), 6, 9,
    ),
}  # fmt: skip


# what a reader of the tables is told of each
MEANINGS = {
    "EXPONENTIAL": "e^r = 1 + r + r²·P(r), |r| ≤ log(2) / 2",
    "LOGARITHM": "log((1+s)/(1−s)) = 2s + s·z·P(z), (1+s)/(1−s) from 1/√2 to √2",
    "LOGARITHM_TAIL": "the same as 2s + s·(2/3·z + z²·P(z)), 2/3 in two words: for powers",
    "SINE": "sin r = r + r·z·P(z), |r| ≤ π/4",
    "COSINE": "cos r = 1 − z/2 + z²·P(z), |r| ≤ π/4",
    "TANGENT": "tan r = r + r·z·P(z), |r| ≤ π/4",
    "ARC_SINE": "asin r = r + r·z·P(z), |r| ≤ 1/2",
    "ARC_TANGENT": "atan r = r + r·z·P(z), |r| ≤ 7/16",
    "HYPERBOLIC_SINE": "sinh r = r + r·z·P(z), |r| ≤ 1",
    "HYPERBOLIC_TANGENT": "tanh r = r + r·z·P(z), |r| ≤ 0.95 in float, ≤ 0.55 in double",
    "LN_2": "log(2) in two words, the first so short that products with exponents are exact",
    "HALF_PI": "π/2 in two words",
    "HALF_PI_PARTS": "π/2 in three words: products of the first two with quarter turns are exact",
    "TWO_THIRDS": "2/3 in two words",
    "ARC_TANGENT_HALF": "angles to which arguments of the arc tangent are reduced, in two words",
    "EXPONENTIAL_LIMITS": "beyond the first e^x rounds to ∞, below the second to 0",
}


def words(value: mpf, digits: int, leading: list[int]) -> list[mpf]:
    """The value as an unevaluated sum; leading words have the given bits, the last one all."""
    parts: list[mpf] = []
    for bits in [*leading, digits]:
        parts.append(round_to(value - sum(parts, mpf(0)), bits))
    return parts


def constants(digits: int) -> dict[str, list[mpf]]:
    single = digits == 24
    return {
        # so few bits that its product with an exponent is exact
        "LN_2": words(mp.log(2), digits, [16 if single else 42]),
        "INVERSE_LN_2": [round_to(1 / mp.log(2), digits)],
        "HALF_PI": words(mp.pi / 2, digits, [digits]),
        "TWO_OVER_PI": [round_to(2 / mp.pi, digits)],
        # so few bits that products with QUARTER_TURNS are exact
        "HALF_PI_PARTS": words(mp.pi / 2, digits, [17, 17] if single else [43, 43]),
        "TWO_THIRDS": words(mpf(2) / 3, digits, [digits]),
        "ARC_TANGENT_HALF": words(mp.atan(mpf(1) / 2), digits, [digits]),
        "ARC_TANGENT_ONE": words(mp.atan(1), digits, [digits]),
        "ARC_TANGENT_THREE_HALVES": words(mp.atan(mpf(3) / 2), digits, [digits]),
        # beyond: rounds to infinity; below: rounds to 0
        "EXPONENTIAL_LIMITS": [
            round_to(mp.log(mpf(2) ** (128 if single else 1024)) - mpf(2) ** -40, digits),
            round_to(mp.log(mpf(2) ** (-150 if single else -1075)), digits),
        ],
    }


def two_over_pi_words(count: int) -> list[int]:
    with mp.workdps(10 * count + 20):  # an entry holds 9.6 decimal digits
        fraction = int(mp.floor(mp.ldexp(2 / mp.pi, 32 * count)))
    return [(fraction >> (32 * (count - 1 - i))) % 2**32 for i in range(count)]


def short_lines(texts: list[str], indent: str) -> str:
    """One string literal of the texts, as many a line as fit."""
    lines = textwrap.wrap(" ".join(texts), 84)
    spaced = [f"{line} " for line in lines[:-1]] + lines[-1:]
    return "".join(f'{indent}"{line}"\n' for line in spaced)


def main() -> None:
    lines = [
        '"""Polynomials and constants of the kernels, one set a format.\n\n',
        "Written by benchmarks/kernel_accuracy/fit_coefficients.py, which holds the definitions. ",
        "P has its\ncoefficients from the constant on; z is the square of r or s.\n",
        '"""\n\n',
        "from __future__ import annotations\n\n",
        "from compiler.kernels.tables.formats import DOUBLE, FLOAT, Format\n\n\n",
        "def _read(texts: str) -> tuple[float, ...]:\n",
        "    return tuple(float.fromhex(text) for text in texts.split())\n\n\n",
        "def _read_words(texts: str) -> tuple[int, ...]:\n",
        "    return tuple(int(text, 16) for text in texts.split())\n",
    ]
    sets: dict[str, list[list[mpf]]] = {}
    for name, (target, weight, low, high, *degrees) in FITS.items():
        sets[name] = []
        ends = high if isinstance(high, tuple) else (high, high)
        for digits, degree, end in zip((24, 53), degrees, ends, strict=True):
            coefficients, error = fit(target, weight, low, end, degree, digits)
            print(f"{name} {digits} bits degree {degree}: 2^{float(mp.log(error, 2)):.1f}")
            sets[name].append(coefficients)
    for name in constants(24):
        sets[name] = [constants(24)[name], constants(53)[name]]
    for name, (single, double) in sets.items():
        lines.append(f"\n# {MEANINGS[name]}" if name in MEANINGS else "")
        lines.append(f"\n{name}: dict[Format, tuple[float, ...]] = {{\n")
        for format, values in (("FLOAT", single), ("DOUBLE", double)):
            body = short_lines([float(value).hex() for value in values], " " * 8)
            lines.append(f"    {format}: _read(\n{body}    ),\n")
        lines.append("}\n")
    lines.append("\nTWO_OVER_PI_WORDS: tuple[int, ...] = _read_words(\n")
    fraction = [f"{word:08X}" for word in two_over_pi_words(37)]
    lines.append(short_lines(fraction, " " * 4) + ")\n")
    lines.append('"""The binary fraction of 2/π, 32 bits an entry."""\n')
    TARGET.write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
