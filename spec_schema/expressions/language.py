"""Lists the predefined names of the language: builtins, loss functions, indices."""

from __future__ import annotations

from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Signature:
    """The arguments of a function of the language, and its purpose in a line."""

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
