"""Proves by abstract interpretation that a step has no run-time error for all declared values.

Frama-C's Eva takes one step from any state and any input within the ranges of the spec, and any
position of a ring. A float that may become infinite or NaN, a conversion that may overflow and an
index that may leave its array are alarms. The project's own math functions stand in it with their
bounds (`kernel_bounds`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from msnn.verification.builds.harness import write_harness
from msnn.verification.exported_c import ExportedC, Member
from msnn.verification.proof.kernel_bounds import kernel_bounds
from msnn.verification.proof_step import Check, Result, run_tool
from msnn.verification.tools import FRAMA_C

ASSUMED = 1e6
"""Magnitude of a value for which the spec declares no range; the report names each."""

_PRECISION = "7"
_ALARM = re.compile(r"\[eva:alarm\] (\S+?):(\d+): Warning:\s*([^\n]*)\n?([^\[]*)")
_SHOWN = re.compile(r"Frama_C_show_each_(\w+):\s*(?:\[(\S+) \.\. (\S+?)\]|\{(\S+?)\})")
_SPEC = re.compile(r"/\* spec: (?:.*\()?([^ ()]+:\d+)\)? *\*/")


def proof_check(model: ExportedC) -> Check:
    """Runs Eva on a main that draws state and inputs from their ranges."""

    def run(folder: Path) -> Result:
        if model.fixed_point:
            detail = "the export proved the bounds of every integer; Eva is asked about floats only"
            return Result(check.name, check.target, "left out", detail)
        main = write_harness(
            "eva_main.c",
            model,
            folder,
            values=[*_drawn("s", model.state, model), *_drawn("u", model.inputs, model)],
            shown=list(_shown(model)),
            kernels=kernel_bounds(model),
        )
        said = run_tool(
            [
                *(FRAMA_C.command, "-eva", "-eva-precision", _PRECISION),
                *("-machdep", "gcc_x86_32"),
                f"-cpp-extra-args=-I{model.include} -I{model.folder / 'src'}",
                *(main, *(p for p in model.model_sources if not p.stem.endswith("_math"))),
            ],
            folder,
        )
        alarms = [_alarm(match, model) for match in _ALARM.finditer(said)]
        proved = _proved(said)
        if len(proved) < sum(not member.unsigned for member in model.outputs):
            alarms.append("no step comes to its end")
        assumed = [m.name for m in (*model.state, *model.inputs) if not m.unsigned and not m.range]
        detail = f"{len(alarms)} alarms, Eva at precision {_PRECISION}"
        notes = [f"proved {name} in {low:.6g} .. {high:.6g}" for name, low, high in proved]
        notes += [f"assumed |{name}| <= {ASSUMED:g}: the spec has no range" for name in assumed]
        return check.of(list(dict.fromkeys(alarms)), detail, notes=notes)

    check = Check("proof", "source", (FRAMA_C,), run)
    return check


def _drawn(struct: str, members: tuple[Member, ...], model: ExportedC) -> Iterator[str]:
    kind = "float" if model.dtype == "float32" else "double"
    suffix = "f" if kind == "float" else ""
    for member in members:
        if member.unsigned:
            value = "(uint32_t)Frama_C_interval(-2147483647 - 1, 2147483647)"
        else:
            low, high = member.range or (-ASSUMED, ASSUMED)
            limits = f"{float(low)!r}{suffix}, {float(high)!r}{suffix}"
            value = f"Frama_C_{kind}_interval({limits})"
        if member.size is None:
            yield f"{struct}.{member.field} = {value};"
        else:
            loop = f"for (uint32_t i = 0U; i < {member.size}U; i++)"
            yield f"{loop} {struct}.{member.field}[i] = {value};"


def _shown(model: ExportedC) -> Iterator[str]:
    for member in model.outputs:
        for index in range(member.size or 1) if not member.unsigned else ():
            place = member.field if member.size is None else f"{member.field}[{index}]"
            yield f"Frama_C_show_each_{member.field}(y.{place});"


def _proved(said: str) -> list[tuple[str, float, float]]:
    """The interval that holds all that was shown of each output."""
    found: dict[str, tuple[float, float]] = {}
    for name, low, high, one in _SHOWN.findall(said):
        bounds = [float(text) for text in ((one, one) if one else (low, high))]
        known = found.get(name, (bounds[0], bounds[1]))
        found[name] = min(known[0], bounds[0]), max(known[1], bounds[1])
    return [(name, *bounds) for name, bounds in found.items()]


def _alarm(match: re.Match[str], model: ExportedC) -> str:
    path, line, what, rest = match.groups()
    claim = " ".join((what + " " + rest).split())
    name = Path(path).name
    place = _spec_line(model, name, int(line))
    return f"{name}:{line}: {claim[:160]}" + (f" (spec {place})" if place else "")


def _spec_line(model: ExportedC, name: str, line: int) -> str | None:
    """Where the spec says what the generated line computes: the last such comment before it."""
    source = model.folder / "src" / name
    if not source.is_file():
        return None
    above = source.read_text(encoding="utf-8").splitlines()[:line]
    found = (match[1] for text in reversed(above) if (match := _SPEC.search(text)))
    return next(found, None)
