"""Generates C of the same model with each tool, and the lines that call its step with one input."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass, replace
from pathlib import Path

import casadi
from by_hand import casadi_step, write_onnx_step

import msnn
from backends.c import COptions, write_c
from backends.casadi_function.function import build_function
from backends.onnx_model.model import write_onnx
from compiler.ir.program import Program
from compiler.passes.retime import retime
from compiler.passes.settle_zeros import settle_zeros
from compiler.passes.simplify import prune_outputs
from compiler.passes.to_step_form import to_step_form

SPEC = Path(__file__).parents[2] / "examples" / "gallery" / "reference.msnn.yaml"


@dataclass(frozen=True, slots=True)
class Contender:
    """The sources of one tool's code, and a folder with `glue.h`, which calls it."""

    name: str
    folder: Path
    sources: tuple[Path, ...]
    includes: tuple[Path, ...] = ()
    flags: tuple[str, ...] = ()

    @property
    def own(self) -> bool:
        return self.name.startswith("msnn")


def contenders(folder: Path, emx: Path) -> list[Contender]:
    """Generates the model by every tool; `emx` is the command of emx-onnx-cgen."""
    program = _reference()
    return [*_own(program, folder), *_casadi(program, folder), *_emx(program, folder, emx)]


def onnx_file(folder: Path) -> Path:
    """Writes the ONNX model that emx-onnx-cgen and onnxruntime read."""
    return folder / "onnx" / "reference.onnx"


def _reference() -> Program:
    """The model in step form; its input is not checked, as in the code of the other tools."""
    return to_step_form(prune_outputs(msnn.load(SPEC).program, ["v_next"]))


_OWN = {
    "default": COptions(),
    "small": COptions(ring="shift", params="inline"),
    "fast": COptions(ring="double", unroll=25),
    "fast, inline": COptions(ring="double", unroll=25, params="inline"),
    "constant time": COptions(constant_time=True),
}


def _own(program: Program, folder: Path) -> list[Contender]:
    program = settle_zeros(retime(program, fixed_parameters=True))
    (signal,) = (signal for signal in program.signals if signal.name == "u")
    others = tuple(other for other in program.signals if other is not signal)
    clamping = replace(program, signals=(replace(signal, on_invalid="clamp"), *others))
    made = [(f"msnn, {name}", program, options) for name, options in _OWN.items()]
    made += [
        ("msnn, clamping", clamping, COptions()),
        ("msnn, clamping, fast", clamping, _OWN["fast"]),
    ]
    found: list[Contender] = []
    for number, (name, chosen, options) in enumerate(made):
        place = folder / f"msnn{number}"
        write_c(chosen, {}, place, replace(options, prefix="ref"))
        params = "" if options.params == "inline" else ", &ref_params_default"
        (place / "glue.h").write_text(_OWN_GLUE.format(params=params), encoding="utf-8")
        sources = tuple(
            path
            for path in sorted((place / "src").glob("*.c"))
            if not path.stem.endswith(("_selftest", "_about"))
        )
        found.append(Contender(name, place, sources, (place / "include",)))
    return found


_OWN_GLUE = """\
#include "ref.h"
static ref_state_t s;
static ref_in_t in;
static ref_out_t out;
static void bench_init(void)
{{
    static const ref_init_t x0;
    ref_reset(&s{params}, &x0);
}}
static inline float bench_step(float u)
{{
    in.u = u;
    (void)ref_step(&s{params}, &in, &out);
    return out.v_next;
}}
"""


def _casadi(program: Program, folder: Path) -> list[Contender]:
    """C by CasADi in single precision, from msnn's export and from a function written by hand.

    CasADi's code calls functions of double precision; the third variant has macros and a flag that
    make them single.
    """
    function = build_function(program)
    ports = [casadi.MX.sym(name, n) for name, n in (("u", 1), ("v", 1), ("h", 24))]
    values = [casadi.DM(list(parameter.initial)) for parameter in program.parameters]
    exported = casadi.Function("step", ports, function.call([*ports, *values]))
    forms = {"CasADi MX, exported": exported, "CasADi SX by hand": casadi_step(program)}
    found: list[Contender] = []
    for name, form in forms.items():
        place = folder / f"casadi{len(found)}"
        place.mkdir(parents=True)
        generator = casadi.CodeGenerator("model.c", {"casadi_real": "float", "with_header": True})
        generator.add(form)
        generator.generate(f"{place}/")
        (place / "glue.h").write_text(_CASADI_GLUE, encoding="utf-8")
        found.append(Contender(name, place, (place / "model.c",), (place,)))
    macros = ("fmax", "fmin", "tanh", "fabs")
    single = folder / "single.h"
    lines = ["#include <math.h>", *(f"#define {name} {name}f" for name in macros)]
    single.write_text("\n".join([*lines, ""]), encoding="utf-8")
    flags = ("-include", str(single), "-fsingle-precision-constant")
    return [*found, replace(found[-1], name="CasADi SX by hand, made single", flags=flags)]


_CASADI_GLUE = """\
#include "model.h"
static float state[2][25];
static int now;
static void bench_init(void)
{
}
static inline float bench_step(float u)
{
    static float y;
    static float w[step_SZ_W + 1];
    static casadi_int iw[step_SZ_IW + 1];
    const float *arg[step_SZ_ARG] = {&u, &state[now][24], state[now]};
    now ^= 1;
    float *res[step_SZ_RES] = {&y, &state[now][24], state[now]};
    (void)step(arg, res, iw, w, 0);
    return y;
}
"""


def _emx(program: Program, folder: Path, emx: Path) -> list[Contender]:
    """C by emx-onnx-cgen, from msnn's export and from a small graph written by hand."""
    write_onnx(program, {}, onnx_file(folder).parent, "reference", "float32")
    by_hand = write_onnx_step(program, folder / "onnx_by_hand" / "reference.onnx")
    models = {"emx-onnx-cgen, exported": onnx_file(folder), "emx-onnx-cgen by hand": by_hand}
    found: list[Contender] = []
    for name, model in models.items():
        place = folder / f"emx{len(found)}"
        place.mkdir()
        source = place / "model.c"
        command = [emx, "compile", model, source, "--large-temp-threshold", "0"]
        subprocess.run([*command, "--model-name", "model"], check=True, stdout=subprocess.DEVNULL)
        (place / "glue.h").write_text(_EMX_GLUE, encoding="utf-8")
        found.append(Contender(name, place, (source,)))
    return found


_EMX_GLUE = """\
void model(const float *u, const float *v, const float *h, float *y, float *vn, float *hn);
static float state[2][25];
static int now;
static void bench_init(void)
{
}
static inline float bench_step(float u)
{
    float y;
    const float *old = state[now];
    now ^= 1;
    model(&u, &old[24], old, &y, &state[now][24], state[now]);
    return y;
}
"""
