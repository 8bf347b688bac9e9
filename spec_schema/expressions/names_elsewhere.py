"""Maps names of Python libraries to the language: `np.maximum`, `math.e`, `np.inf`."""

from __future__ import annotations

from collections.abc import Collection

from spec_schema.diagnostics.suggest import did_you_mean, nearest
from spec_schema.expressions.language import ELSEWHERE, NUMBERS

_LIBRARIES = frozenset(
    [
        "ca",
        "cas",
        "casadi",
        "cmath",
        "cs",
        "jax",
        "jnp",
        "math",
        "np",
        "numpy",
        "onp",
        "scipy",
        "sp",
        "sympy",
        "tf",
        "torch",
    ]
)

FORMULAS = {
    "array": "write a list as it is: `[1, 2]`",
    "asarray": "write a list as it is: `[1, 2]`",
    "cbrt": "write `sign(x) * abs(x)**(1/3)`",
    "clamp": "write `clip(x, low, high)`",
    "deg2rad": "write `x * pi / 180`",
    "degrees": "write `x * 180 / pi`",
    "dot": "write `a @ b`",
    "e": "write `exp(1)`: Euler's number has no name of its own",
    "exp2": "write `2**x`",
    "expm1": "write `exp(x) - 1`",
    "float": "leave it out: every value is a floating point number",
    "float32": "leave it out: `dtype:` of a stage or an export chooses the type of all values",
    "float64": "leave it out: `dtype:` of a stage or an export chooses the type of all values",
    "heaviside": "write `where(x > 0, 1, 0)`",
    "hypot": "write `sqrt(x**2 + y**2)`",
    "inf": "no number is infinite here: leave a bound out, as in `max(x, low)`",
    "infinity": "no number is infinite here: leave a bound out, as in `max(x, low)`",
    "log10": "write `log(x) / log(10)`",
    "log1p": "write `log(1 + x)`",
    "log2": "write `log(x) / log(2)`",
    "matmul": "write `a @ b`",
    "nan": "no number is NaN here: write the one that holds there, or leave cells of data empty",
    "norm": "write `sqrt(sum(x**2))`",
    "rad2deg": "write `x * 180 / pi`",
    "radians": "write `x * pi / 180`",
    "reciprocal": "write `1 / x`",
    "rsqrt": "write `1 / sqrt(x)`",
    "square": "write `x**2`",
    "sat": "write `clip(x, low, high)`",
    "saturate": "write `clip(x, low, high)`",
    "saturation": "write `clip(x, low, high)`",
    "tau": "write `2 * pi`",
    "tensor": "write a list as it is: `[1, 2]`",
}
"""What needs no name of its own here, and how it is written."""


def written_here(library: str, name: str, functions: Collection[str]) -> str | None:
    """The help line for `library.name` where nothing of the spec is called `library`, or None.

    `functions` are those of the language.
    """
    here = ELSEWHERE.get(name, name)
    # `Math.PI` is how JavaScript has it
    number = name.lower()
    if number in NUMBERS:
        return f"write `{number}`: numbers of the language stand without a prefix"
    if here in functions:
        return f"write `{here}(…)`: functions of the language stand without a prefix"
    if library.partition(".")[0].lower() not in _LIBRARIES:
        return None
    return formula_for(name) or _nearest_function(name, functions)


def formula_for(name: str) -> str | None:
    """The help line for a name that the language does without, or None."""
    return FORMULAS.get(name.lower())


def _nearest_function(name: str, functions: Collection[str]) -> str:
    meant = did_you_mean(nearest(name, functions))
    return meant or "expressions are not run by Python: functions of the language have no prefix"
