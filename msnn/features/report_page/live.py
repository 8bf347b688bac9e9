"""Prepares the live model of the page: its C code as WebAssembly, its ports, its golden steps."""

from __future__ import annotations

import base64
import json
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from backends.c.host.build import CompilerFailedError
from backends.c.host.library import NUMBERS, StructMemory
from backends.files.c_compiler import CompilerTooSlowError, run_compiler, zig_program
from compiler.differentiation.estimated_starts import estimated_states
from compiler.ir.program import Program
from msnn.data.dataset import Dataset, FloatArray
from msnn.errors.failures import MissingExtraError
from msnn.exports.export import plan_exports, write_export
from msnn.features.report_page.packing import Plain
from msnn.features.report_page.records import Ports
from msnn.model.model import Model
from msnn.packages import ZIGLANG
from msnn.reports.drawn import MOST_ELEMENTS, element_name
from msnn.simulation.simulate import Simulation
from msnn.verification.exported_c import ExportedC, includes, read_exported_c
from msnn.verification.harness import TEMPLATES, write_harness
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.registry import ARITHMETICS
from spec_schema.units.unit import ONE

_MOST_INPUTS = 40
"""Maximum number of elements with sliders."""
_LARGEST = 600_000
"""Maximum bytes of WebAssembly and golden steps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveModel:
    """A model that the page can run in the browser. `values` is the JSON object that the page
    reads: WebAssembly, ports, golden steps; `ports` are the signals that it needs from recordings.
    """

    values: Plain
    ports: Ports
    memory: Mapping[str, int]
    """Bytes of one instance and of its trained values, by description."""


@dataclass(frozen=True, slots=True)
class NotLive:
    """The reason why the page cannot run the model, and a repair; None if there is none."""

    reason: str
    repair: str | None = None


def live_model(
    model: Model,
    weights: Mapping[str, FloatArray],
    data: Dataset | None,
    runs: Sequence[Simulation] = (),
) -> LiveModel | NotLive:
    """Compiles the C code of `msnn export --to c` to WebAssembly for the page, and describes its
    ports.

    `data` gives the ranges of sliders. States with an estimated initial value start from the
    estimates of `runs`. Returns NotLive if the model cannot be exported to C, its arithmetic is
    fixed point, zig is missing or fails, or the result is too large for the page.
    """
    findings = Findings()
    plans = plan_exports(model, ("c",), findings, weights=weights)
    if findings.failed or not plans:
        return NotLive("the model has no export to C")
    if plans[0].dtype in ARITHMETICS:
        return NotLive("its C computes in fixed point, whose numbers the page cannot show yet")
    with tempfile.TemporaryDirectory() as place:
        folder, build = Path(place) / "c", Path(place) / "build"
        build.mkdir()
        try:
            write_export(plans[0], weights, folder)
            exported = read_exported_c(folder)
            module = web_assembly(exported, build)
        except MissingExtraError as error:
            return NotLive(str(error), error.diagnostic.help)
        except SpecError as error:
            return NotLive(error.diagnostics[0].message, error.diagnostics[0].help)
        except CompilerFailedError as error:
            return NotLive(f"zig did not compile its C to WebAssembly: {error.said[0]}")
        # inside `with`: the folder is gone after it
        about = json.loads((folder / f"{exported.prefix}.json").read_text(encoding="utf-8"))
    expected = "\n".join(exported.expected)
    # base64 takes four bytes for three
    if len(module) * 4 // 3 + len(expected) > _LARGEST:
        return NotLive("its C and golden steps would make the page too large")
    inputs = _ports(about, "in", "inputs", data)
    if sum(len(port["elements"]) for port in inputs) > _MOST_INPUTS:
        return NotLive(f"it has more than {_MOST_INPUTS} numbers as inputs")
    outputs = _outputs(about, model.program)
    for port in inputs:
        port["fed_by"] = _fed_by(port, outputs)
        port["held"] = port["signal"] not in linear_inputs(model)
    start = _ports(about, "init", "start_windows", data)
    for port in start:
        _describe_start(port, model.program, runs)
    values: Plain = {
        "wasm": base64.b64encode(module).decode("ascii"),
        "dtype": about["c"]["dtype"],
        # whether golden steps are met to the bit; else within a tolerance, as where the C calls a
        # libm
        "exact": exported.exact,
        "sample_time": about["sample_time"],
        "status": {
            str(bit): name.partition("_STATUS_")[2].replace("_", " ").lower()
            for name, bit in exported.status.items()
            if "_STATUS_" in name
        },
        "expected": expected,
        "inputs": inputs,
        "outputs": outputs,
        "start": start,
    }
    return LiveModel(
        values=values, ports=_ports_read([*inputs, *start], outputs), memory=_memory(about["c"])
    )


def linear_inputs(model: Model) -> frozenset[str]:
    """The names of the inputs that the spec interpolates linearly between samples."""
    return frozenset(name for name, entry in model.spec.inputs.items() if entry.is_linear)


def _ports(about: Plain, struct: str, kind: str, data: Dataset | None) -> list[Plain]:
    """The fields of the C struct `struct` as JSON objects: offset, size, elements, unit, range.

    `about` is the description that is exported with the C code; `kind` is its list of the ports in
    this struct, `inputs` or `start_windows`.
    """
    # a field without a port is time, or a flag that no record has
    described = {port["port"]: port for port in about[kind]}
    return [
        _port(field, offset, described.get(field["field"]), data)
        for field, offset in _fields(about["c"], struct)
    ]


def _port(field: Plain, offset: int, port: Plain | None, data: Dataset | None) -> Plain:
    first, last = (port["first_sample"], port["last_sample"]) if port else (0, 0)
    # dtype: the product of no numbers would be 1.0
    size = int(np.prod(field["shape"], dtype=np.int64))
    indices = _indices(field["shape"], size // (last - first + 1), last > first)
    low, high, initial = _slider(field, port, data)
    return {
        "name": field["name"],
        "signal": None if port is None else port["name"],
        "unit": _unit(port),
        "doc": (port or {}).get("doc", "").strip().partition("\n")[0],
        "offset": offset,
        "size": size,
        "elements": [element_name("", index) for index in indices],
        "names": [element_name(field["name"], index) for index in indices],
        "first": first,
        "last": last,
        "low": low,
        "high": high,
        "initial": initial,
        "fed_by": None,
        "begins": None,
    }


def _describe_start(port: Plain, program: Program, runs: Sequence[Simulation]) -> None:
    """Sets the slider range and initial values of `port` if it is a state with an estimated initial
    value: its declared range, else a range around the estimates of `runs`, else -1 to 1.
    """
    state = next((s for s in estimated_states(program) if s.name == port["name"]), None)
    if state is None or port["signal"] is not None:
        return
    known = np.array([run.starts[state.name].ravel() for run in runs if state.name in run.starts])
    known = known.reshape(len(known), port["size"])
    low, high = state.range or (None, None)
    if known.size:
        # as far again as the records are apart; of one record as far as its value is from 0
        room = float(np.ptp(known)) or float(np.abs(known).max()) or 1.0
        low = float(known.min()) - room if low is None else low
        high = float(known.max()) + room if high is None else high
    port["unit"] = "" if state.unit is None or state.unit == ONE else state.unit.text
    port["low"], port["high"] = -1.0 if low is None else low, 1.0 if high is None else high
    first = known[0].tolist() if known.size else [0.0] * port["size"]
    port["begins"] = [min(max(value, port["low"]), port["high"]) for value in first]


def _unit(port: Plain | None) -> str:
    unit = None if port is None else port["unit"]
    return "" if unit in (None, "1") else str(unit)


def _indices(shape: Sequence[int], count: int, has_window: bool) -> list[tuple[int, ...]]:
    """The index of each element of a C array of this shape, in order; a window axis, which is the
    last, is left out. `count` is the number of elements per sample. If the shape lacks an axis of
    1, elements are numbered from 0.
    """
    axes = shape[:-1] if has_window else shape
    found = list(np.ndindex(*axes))
    # an axis of 1 may be missing in the shape of C: elements are then numbered flat
    return found if len(found) == count else [(number,) for number in range(count)]


def _outputs(about: Plain, program: Program) -> list[Plain]:
    """The fields of the C struct of results as JSON objects, with the signal that each predicts
    (None for other outputs) and how many samples ahead of the latest input.
    """
    ahead = {output.name: output.predicts for output in program.outputs}
    described = {port["port"]: port for port in about["outputs"]}
    found: list[Plain] = []
    for field, offset in _fields(about["c"], "out"):
        port = described[field["field"]]
        size = int(np.prod(field["shape"], dtype=np.int64))
        predicts = ahead.get(field["name"])
        indices = list(np.ndindex(*field["shape"]))[:MOST_ELEMENTS]
        found.append(
            {
                "name": field["name"],
                "unit": _unit(port),
                "offset": offset,
                "size": size,
                "elements": [element_name("", index) for index in indices],
                "predicts": None if predicts is None else predicts.signal,
                # counted from the sample that the step is given, which `late` makes an earlier one
                # (decision 0209)
                "ahead": 0 if predicts is None else predicts.ahead - about.get("late", 0),
            }
        )
    return found


def _fields(layout: Plain, struct: str) -> list[tuple[Plain, int]]:
    """The members of a C struct with their byte offsets in WebAssembly (wasm32). `layout` describes
    the structs of the exported C code by name.
    """
    fields: list[Plain] = layout["structs"][struct]
    # numpy's aligned dtypes follow the rules of C: each field at a multiple of its size
    dtype = StructMemory(fields, NUMBERS[layout["dtype"]]).dtype
    found: Any = dtype.fields or {}
    return [(field, int(found[field["field"]][1])) for field in fields]


def _slider(field: Plain, port: Plain | None, data: Dataset | None) -> tuple[float, float, float]:
    """Minimum, maximum and initial value of a slider, from the declared range, else from the
    minimum, maximum and median in the data, else -1, 1 and 0. Minimum < maximum always holds.
    """
    declared: list[float | None] = field["range"] or [None, None]
    low, high, middle = -1.0, 1.0, 0.0
    if port is not None and data is not None and port["name"] in data.series:
        known = data.series[port["name"]]
        known = known[np.isfinite(known)]
        if len(known):
            low, high = float(known.min()), float(known.max())
            middle = float(np.median(known))
    low = low if declared[0] is None else declared[0]
    high = high if declared[1] is None else declared[1]
    # a signal that never moves still needs a slider with two ends
    if not low < high:
        low, high = low - 1.0, low + 1.0
    return low, high, min(max(middle, low), high)


def _fed_by(port: Plain, outputs: Sequence[Plain]) -> int | None:
    """The index of the output that the page feeds back into an input, or None.

    It predicts a sample of this input that is newer than all that the step reads, and has as many
    elements.
    """
    for number, output in enumerate(outputs):
        if (
            output["predicts"] == port["signal"]
            # later than all that the step reads: otherwise the record has to give it
            and output["ahead"] > port["last"]
            and len(output["elements"]) == len(port["elements"])
        ):
            return number
    return None


def _ports_read(ports: Sequence[Plain], outputs: Sequence[Plain]) -> Ports:
    back = max([0, *(-port["first"] for port in ports)])
    last = max([0, *(port["last"] for port in ports)])
    return Ports(
        back=back,
        ahead=max([last, *(output["ahead"] for output in outputs)]),
        signals=frozenset(port["signal"] for port in ports if port["signal"] is not None),
    )


def _memory(layout: Plain) -> dict[str, int]:
    types = NUMBERS[layout["dtype"]]
    sizes = {
        name: StructMemory(fields, types).dtype.itemsize
        for name, fields in layout["structs"].items()
    }
    # parameters lie in a struct only where the export lets them be set
    kept = {"state of one instance": sizes["state"]}
    return kept | ({"trained values": sizes["params"]} if layout["takes_parameters"] else {})


_FLAGS = (
    "-target",
    "wasm32-freestanding",
    "-std=c99",
    "-O2",
    "-ffreestanding",
    "-fno-builtin",
    "-ffp-contract=off",
    "-nostdlib",
    "-Wl,--no-entry",
)
_ROOM = 4096
"""Bytes for messages after the golden steps."""


def web_assembly(model: ExportedC, folder: Path) -> bytes:
    """Compiles exported C code with zig; returns the WebAssembly module. `folder` receives the
    harness and intermediate files.

    The flags are those for microcontrollers: no library, no fused operations. Raises
    MissingExtraError without zig, and CompilerFailedError if zig fails, takes too long, or the code
    needs a library.
    """
    ZIGLANG.require("compiles the model of a report to WebAssembly")
    zig = zig_program()
    assert zig is not None, "it is installed"
    write_harness("replay.h", model, folder)
    room = sum(len(line) + 8 for line in model.expected) + _ROOM
    main = write_harness("browser_main.c", model, folder, room=room)
    freestanding = TEMPLATES / "freestanding"
    sources = [*model.sources, main, freestanding / "library.c"]
    module = folder / "model.wasm"
    command = [
        *(str(zig), "cc", *_FLAGS),
        *(f"-I{freestanding}", f"-I{folder}", *includes(model)),
        *(str(path) for path in sources),
        *("-o", str(module)),
    ]
    try:
        done = run_compiler(command, folder=folder)
    except CompilerTooSlowError as error:
        raise CompilerFailedError(command, f"it {error}") from None
    if done.code != 0:
        raise CompilerFailedError(command, done.errors + done.output)
    return module.read_bytes()
