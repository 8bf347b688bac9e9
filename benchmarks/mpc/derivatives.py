"""Times value, Jacobian and Hessian of a small network in C, generated in several ways.

    python benchmarks/mpc/derivatives.py [--rounds N] [--folder BUILD]

The plant is x + mlp(x, u) with two states, one control and two hidden layers of 16. All variants
compute x', J (2 × 3) and the Hessian of λᵀx' (3 × 3) at the same points, in float64, compiled with
`gcc -O2`, in one program that calls them in turn; times are medians of the rounds.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import casadi
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from backends.casadi_function.function import build_function
from backends.casadi_function.options import Form
from benchmarks.mpc.derivatives_in_c import derivatives_source
from compiler.hessian.step_derivatives import step_derivatives
from compiler.ir.program import Program
from compiler.passes.inline_parameters import inline_parameters
from compiler.passes.simplify import prune_outputs
from compiler.passes.to_step_form import to_step_form
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights

HERE = Path(__file__).resolve().parent
CASADI = {
    "casadi_hand_sx": "CasADi, written by hand in SX",
    "casadi_sx_inline": "CasADi, exported: form sx, params inline",
    "casadi_mx_inline": "CasADi, exported: form mx, params inline",
}
NAMES = {
    "own": "own C",
    "own_libm": "own C, tanh of the C library",
    "matrix_by_hand": "C by hand, matrix loops, tanh of the C library",
    **CASADI,
}
REFERENCE = "casadi_hand_sx"


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--rounds", type=int, default=301)
    options.add_argument("--folder", type=Path)
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        program = built(folder)
        said = subprocess.run(
            [program, str(given.rounds)], check=True, capture_output=True, text=True
        )
    print(said.stdout, end="")


def built(folder: Path) -> Path:
    """Builds the program that times all variants."""
    model = load_model(HERE / "mlp_plant.msnn.yaml")
    weights = initial_weights(model.program)
    program = to_step_form(prune_outputs(model.program, ["y"]))
    found = step_derivatives(program, outputs=())
    (folder / "own.c").write_text(derivatives_source(found, weights, "own"))
    (folder / "own_libm.c").write_text(derivatives_source(found, weights, "own_libm", "libm"))
    (folder / "weights.h").write_text(_weights_text(weights))
    steps = {
        "casadi_hand_sx": _by_hand(weights),
        "casadi_sx_inline": _step(program, weights, "sx"),
        "casadi_mx_inline": _step(program, weights, "mx"),
    }
    for name, step in steps.items():
        _derivatives(step, name).generate(f"{name}.c", {"casadi_int": "int", "main": False})
        Path(f"{name}.c").rename(folder / f"{name}.c")
    sources = [f"{name}.c" for name in NAMES if name != "matrix_by_hand"]
    calls = [_casadi_call(name) for name in CASADI]
    text = (HERE / "derivatives_main.c").read_text()
    text = text.replace("/* CASADI */", "\n".join(calls))
    rows = [f'{{"{said}", {name}_call}}' for name, said in NAMES.items()]
    text = text.replace("/* ROWS */", ",\n    ".join(rows))
    (folder / "main.c").write_text(text)
    command = ["gcc", "-O2", "-ffp-contract=off", "-o", "measure", "main.c", *sources, "-lm"]
    subprocess.run(command, check=True, cwd=folder)
    return folder / "measure"


def _weights_text(weights: dict[str, np.ndarray]) -> str:
    lines: list[str] = []
    for name, value in weights.items():
        numbers = ", ".join(float(x).hex() for x in np.ravel(value))
        flipped = ", ".join(float(x).hex() for x in np.ravel(np.transpose(value)))
        size = np.size(value)
        spelled = re.sub(r"\W", "_", name)
        lines.append(f"static const double {spelled}[{size}] = {{{numbers}}};")
        lines.append(f"static const double {spelled}_t[{size}] = {{{flipped}}};")
    return "\n".join(lines) + "\n"


def _by_hand(weights: dict[str, np.ndarray]) -> casadi.Function:
    x, u = casadi.SX.sym("x", 2), casadi.SX.sym("u")
    value = casadi.vertcat(x, u)
    for layer in (1, 2):
        product = casadi.DM(weights[f"net.weight{layer}"]) @ value
        value = casadi.tanh(product + weights[f"net.bias{layer}"])
    following = x + casadi.DM(weights["net.weight3"]) @ value + weights["net.bias3"]
    return casadi.Function("step", [x, u], [following], ["x", "u"], ["x_next"])


def _step(program: Program, weights: dict[str, np.ndarray], form: Form) -> casadi.Function:
    inner: Any = build_function(inline_parameters(program, weights), form=form)
    kind: Any = casadi.SX if form == "sx" else casadi.MX
    x, u = kind.sym("x", 2), kind.sym("u")
    values = {"th": x[0], "w": x[1], "u": u}
    found = inner.call(values)
    following = casadi.vertcat(found["th_next"], found["w_next"])
    return casadi.Function("step", [x, u], [following], ["x", "u"], ["x_next"])


def _derivatives(step: Any, name: str) -> casadi.Function:
    """The function of z = (x, u) and λ that returns x', J and H."""
    kind: Any = casadi.SX if step.is_a("SXFunction") else casadi.MX
    z, multipliers = kind.sym("z", 3), kind.sym("lambda", 2)
    following = step(z[:2], z[2])
    jacobian = casadi.jacobian(following, z)
    hessian, _ = casadi.hessian(casadi.dot(multipliers, following), z)
    results = [following, casadi.densify(jacobian), casadi.densify(hessian)]
    return casadi.Function(name, [z, multipliers], results)


def _casadi_call(name: str) -> str:
    return f"""
int {name}(const double **arg, double **res, int *iw, double *w, int mem);
int {name}_work(int *arg, int *res, int *iw, int *w);
static void {name}_call(const double *z, const double *lambda, double *r, double *J, double *H)
{{
    static double w[100000];
    static int iw[10000];
    const double *arg[64] = {{z, lambda}};
    double *res[64] = {{r, J, H}};
    {name}(arg, res, iw, w, 0);
}}"""


if __name__ == "__main__":
    main()
