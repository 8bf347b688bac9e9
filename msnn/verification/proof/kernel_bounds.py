"""Gives Eva bounds of the math functions in generated C.

Inside these functions, interval analysis loses the relations between quantities; each function is
tested separately over all floats. Eva itself knows exp, log, pow, sin and cos of an interval.
"""

from __future__ import annotations

import re

import numpy as np

from msnn.verification.exported_c import ExportedC

# {f} ends the name of a function of <math.h>; `near` allows for rounding, {e} for what is lost
# of numbers of about 1
_BODIES = {
    "exp": "return near(exp{f}(x));",
    "log": "return near(log{f}(x));",
    "pow": "return near(pow{f}(x, y));",
    "sin": "return between(-1.0, 1.0, near(sin{f}(x)));",
    "cos": "return between(-1.0, 1.0, near(cos{f}(x)));",
    "tan": "return near(sin{f}(x) / cos{f}(x));",
    "asin": "/*@ assert -1.0 <= x <= 1.0; */ return any(-1.5707964, 1.5707964);",
    "acos": "/*@ assert -1.0 <= x <= 1.0; */ return any(0.0, 3.1415928);",
    "atan": "return any(-1.5707964, 1.5707964);",
    "atan2": "return any(-3.1415928, 3.1415928);",
    "sinh": "return beyond(x, near((exp{f}(x) - exp{f}(-x)) / 2 + any(-{e}, {e})));",
    "cosh": "return least(1.0, near((exp{f}(x) + exp{f}(-x)) / 2));",
    "tanh": "return any(-1.0, 1.0);",
    "sigmoid": "return any(0.0, 1.0);",
    "softplus": "return near(((x > 0) ? x : 0) + any(0.0, 0.6931472));",
    "sqrt": "return sqrt{f}(x);",
}
KNOWN = frozenset(_BODIES)
_PROTOTYPE = re.compile(r"^(?:float|double) (\w+)\(([^()]*)\);$", re.MULTILINE)


def kernel_bounds(model: ExportedC) -> list[str]:
    """A definition for each function declared in the export's math header."""
    header = model.folder / "src" / f"{model.prefix}_math.h"
    if not header.is_file():
        return []
    single = model.dtype == "float32"
    suffix = "f" if single else ""
    limits = np.finfo(np.float32 if single else np.float64)
    largest, lost = float(limits.max), f"{float(limits.eps):.3g}"
    found: list[str] = []
    for name, arguments in _PROTOTYPE.findall(header.read_text(encoding="utf-8")):
        body = _BODIES.get(name.removeprefix(f"{model.prefix}_"))
        if body is None:
            body = f"return any({-largest!r}, {largest!r});"
        # what a bound does not depend on
        unused = [f"(void){argument.split()[-1]};" for argument in arguments.split(",")]
        real = f"{model.prefix}_real"
        lines = [*unused, body.replace("{f}", suffix).replace("{e}", lost)]
        found.append(
            "\n".join([f"{real} {name}({arguments})", "{", *(f"    {line}" for line in lines), "}"])
        )
    return found
