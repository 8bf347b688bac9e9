"""Lists the predefined names of the language, and their names in libraries of Python."""

from __future__ import annotations

from collections.abc import Collection

from spec_schema.diagnostics.suggest import did_you_mean, nearest
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Signature:
    """The numbers and keywords of arguments that a function of the language takes, and its
    description.
    """

    least: int
    most: int | None
    keywords: tuple[str, ...] = ()
    doc: str = ""

    def takes(self, count: int) -> bool:
        """True if the function accepts that many arguments."""
        return self.least <= count and (self.most is None or count <= self.most)

    @property
    def wanted(self) -> str:
        """The number of arguments in words."""
        if self.most is None:
            return f"{self.least} or more arguments"
        if self.least == self.most:
            return f"{self.least} argument{'s' if self.least > 1 else ''}"
        between = "or" if self.most == self.least + 1 else "to"
        return f"{self.least} {between} {self.most} arguments"


BUILTINS: dict[str, Signature] = {
    "relu": Signature(1, 1, doc="max(x, 0), in the unit of x; slope 0 at 0."),
    "elu": Signature(1, 1, doc="x above 0, exp(x) − 1 below, in the unit of x."),
    "sech": Signature(1, 1, doc="1 / cosh(x)."),
    "min": Signature(2, None, doc="The smallest argument, element by element."),
    "max": Signature(2, None, doc="The largest argument, element by element."),
    "clip": Signature(3, 3, doc="clip(x, low, high)."),
    "where": Signature(3, 3, doc="where(condition, then, otherwise)."),
    "sum": Signature(1, 1, ("over",), "Sum of everything, or over the axes of `over=`."),
    "mean": Signature(1, 1, ("over",), "Mean of everything, or over the axes of `over=`."),
    "concat": Signature(1, None, doc="Scalars, lists and windows one after the other."),
    "stack": Signature(1, None, ("dim",), "The arguments side by side along a new axis."),
    "part": Signature(2, 2, doc="One element of an axis, by label or index."),
    "softmax": Signature(1, 1, ("over",), "Shares that sum to 1 along an axis."),
    "outer": Signature(2, 2, doc="outer(a, b): all products of an element of each."),
    "eye": Signature(1, 2, doc="eye(a, b) of two dims; eye(3) in `constants:`."),
    "smooth_sign": Signature(1, 2, doc="smooth_sign(x, width) = tanh(x / width)."),
    "dropout": Signature(2, 2, doc="dropout(x, share): x, of which training leaves out a share."),
    "linspace": Signature(3, 3, doc="linspace(first, last, count)."),
    "arange": Signature(1, 3, doc="arange(start, stop, step), stop excluded."),
    "integral": Signature(1, 1, ("method", "init"), "Integral over time since the start of a run."),
    "der": Signature(1, 1, ("method",), "Derivative with respect to time."),
    "grad": Signature(2, 2, doc="grad(y, x): Σ ∂y/∂x in one sample, shape of x."),
    "zeros": Signature(1, 1, doc="zeros(count)."),
    "ones": Signature(1, 1, doc="ones(count)."),
}
"""Functions of every expression, beside the scalar functions of the compiler's table."""

LOSS_FUNCTIONS: dict[str, Signature] = {
    "mse": Signature(1, 2, doc="Mean of squared differences."),
    "rmse": Signature(1, 2, doc="Root of the mean of squared differences."),
    "mae": Signature(1, 2, doc="Mean of absolute differences."),
    "huber": Signature(
        1, 2, ("delta",), "e²/2 of differences up to delta (default 1), a straight line beyond."
    ),
    "l1": Signature(1, 1, doc="Mean magnitude; takes numbers of learned arrays to exactly 0."),
    "l2": Signature(1, 1, doc="Mean square of parameters."),
    "group": Signature(1, 1, ("over",), doc="Σ over a dim of the norm of each slice of an array."),
    "cross_entropy": Signature(2, 2, doc="How improbable the model finds the recorded class."),
}
"""Functions that stand in the sum of a loss and nowhere else."""

# by what people type, so that the message names the function that they mean, however unlike it is
ELSEWHERE = {
    "absolute": "abs",
    "arccos": "acos",
    "arcsin": "asin",
    "arctan": "atan",
    "arctan2": "atan2",
    "average": "mean",
    "cat": "concat",
    "concatenate": "concat",
    "expit": "sigmoid",
    "fabs": "abs",
    "fmax": "max",
    "fmin": "min",
    "if": "where",
    "if_else": "where",
    "ln": "log",
    "maximum": "max",
    "minimum": "min",
    "power": "pow",
    "sgn": "sign",
}
"""Names of builtins in other languages, with the name here."""

STATE_FUNCTIONS = ("next", "flow")
"""What is asked of a state: its value after the step, its derivative."""

TIME_NAMES = ("t", "dt")
NUMBERS = {"pi": 3.141592653589793}

INDICES = ("i", "j", "k", "l", "m")
"""Names of the indices of an array's axes in formulas, from the first axis, counted from 0."""

LENGTH = "n"
"""Name of the length of the last axis in formulas."""


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
    """The help line for `library.name`, as in `np.sin`, with the function of the language; None if
    unknown.

    `functions` are the names of the language. It is used if nothing in the spec is called
    `library`.
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
    """The help line for a function that the language lacks: a formula for it; None if unknown."""
    return FORMULAS.get(name.lower())


def _nearest_function(name: str, functions: Collection[str]) -> str:
    meant = did_you_mean(nearest(name, functions))
    return meant or "expressions are not run by Python: functions of the language have no prefix"
