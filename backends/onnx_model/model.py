"""Builds and writes ONNX models of a step-form program: a step, a rollout, initial states."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import ArrayLike, DTypeLike
from onnx import helper

from backends.files.atomic_write import write_bytes, write_text
from backends.files.text_templates import one_line, readme_text
from backends.onnx_model.draft import STEPS, Draft
from backends.onnx_model.lowering import LeafNodes, OnnxNodes, lower_nodes
from backends.ports.identifiers import c_identifier
from backends.ports.step_interface import PortNames, port_names, step_interface
from compiler.ir.program import Program

Weights = Mapping[str, ArrayLike] | None


def build_model(
    program: Program, weights: Weights = None, dtype: DTypeLike = np.float64
) -> onnx.ModelProto:
    """An ONNX model of one step: (inputs, states) → (outputs, next states), with parameters as
    initialisers.

    `onnx_names` gives the names of values; each has the axes of the spec, the window last.
    `weights` are physical arrays by name; a missing one, or None, means initial values. Raises
    ValueError for a program in window form, a dtype other than float32 and float64 or a weight of a
    wrong shape.
    """
    draft = Draft.of(program, weights, dtype)
    names, nodes = draft.names, draft.nodes()
    draft.lower_step(nodes, names)
    arguments = [*draft.inputs(names), *draft.states(names.states)]
    results = [*draft.outputs(names), *draft.states(names.next_states)]
    return draft.model("step", nodes, arguments, results, draft.interface.parameters)


def build_rollout(
    program: Program, weights: Weights = None, dtype: DTypeLike = np.float64
) -> onnx.ModelProto:
    """An ONNX model of many steps as one `Scan`: (initial states, series of inputs) → (final
    states, series of outputs).

    A series has the axis `steps` first, then those of the port. A program without inputs gets the
    input `steps`, a vector whose length is the number of steps. `weights` are physical arrays by
    name; a missing one, or None, means initial values. Raises ValueError for a program in window
    form, a dtype other than float32 and float64 or a weight of a wrong shape.
    """
    draft = Draft.of(program, weights, dtype)
    names, nodes = draft.names, draft.nodes()
    # a graph and its subgraphs share one namespace in ONNX
    inside = _inside(names, nodes)
    body = OnnxNodes(nodes.dtype, nodes.taken)
    draft.lower_step(body, inside)
    # a Scan needs a series for its number of steps
    clock = draft.value(c_identifier("step", nodes.taken), (), "")
    body_graph = helper.make_graph(
        body.nodes,
        "step",
        [*draft.states(inside.states), *(draft.inputs(inside) or [clock])],
        [*draft.states(inside.next_states), *draft.outputs(inside)],
        body.initializers,
    )
    clocks = draft.value(STEPS, (), "only its length counts", series=True)
    series = draft.inputs(names, series=True) or [clocks]
    arguments = [*draft.states(names.states), *series]
    results = [*draft.states(names.next_states), *draft.outputs(names, series=True)]
    scan = helper.make_node(
        "Scan",
        [value.name for value in arguments],
        [value.name for value in results],
        name="rollout",
        # the last arguments are scanned, the first are the state
        num_scan_inputs=len(series),
        body=body_graph,
    )
    nodes.nodes.append(scan)
    return draft.model("rollout", nodes, arguments, results, draft.interface.parameters)


def build_initial_state(
    program: Program, weights: Weights = None, dtype: DTypeLike = np.float64
) -> onnx.ModelProto:
    """An ONNX model of the states before the first step, from windows of recorded samples around
    it.

    A window has the samples t0+first … t0+last that its documentation and the metadata give.
    `weights` are physical arrays by name; a missing one, or None, means initial values. Raises
    ValueError for a program in window form, a dtype other than float32 and float64 or a weight of a
    wrong shape. Also for a program without states, as a model without results cannot be loaded.
    """
    if not program.states:
        message = f"`{program.name}` has no states, so nothing gives their first values"
        raise ValueError(message)
    draft = Draft.of(program, weights, dtype)
    names, interface, nodes = draft.names, draft.interface, draft.nodes()
    windows = {
        port.signal.name: (port, names.start_windows[port.signal.name])
        for port in interface.start_windows
    }
    sources = LeafNodes(windows, {}, names.parameters, draft.weights)
    values = lower_nodes(draft.program.start, interface.start_nodes, sources, nodes)
    for state in interface.states:
        nodes.add_as(names.states[state.name], "Identity", [values[state.start]])
    results = draft.states(names.states)
    return draft.model(
        "initial_state", nodes, draft.start_windows(), results, interface.start_parameters
    )


def onnx_names(program: Program) -> PortNames:
    """The names of the values at the ports of the three models, by name in the spec. Raises
    ValueError for a program in window form.
    """
    return port_names(step_interface(program), (STEPS,))


def _inside(names: PortNames, nodes: OnnxNodes) -> PortNames:
    """New names for the ports of the step inside a `Scan`, since ONNX requires them to differ from
    those outside; they are added to the taken names of `nodes`.
    """

    def renamed(table: dict[str, str]) -> dict[str, str]:
        return {key: c_identifier(f"{name}.now", nodes.taken) for key, name in table.items()}

    return PortNames(
        inputs=renamed(names.inputs),
        states=renamed(names.states),
        parameters=names.parameters,
        outputs=renamed(names.outputs),
        next_states=renamed(names.next_states),
        start_windows=names.start_windows,
    )


def write_onnx(
    program: Program,
    weights: Mapping[str, ArrayLike] | None,
    folder: Path,
    prefix: str,
    dtype: DTypeLike = np.float64,
) -> tuple[Path, ...]:
    """Writes the ONNX models of a program in step form to `folder`; returns the paths.

    The files are `<prefix>.onnx`, `<prefix>_rollout.onnx`, a README `<prefix>_onnx.md`, and for a
    program with states `<prefix>_initial_state.onnx`. `weights` (physical arrays by name) or the
    initial values become initialisers. Raises OSError if a file cannot be written, ValueError for a
    program in window form, a dtype other than float32 and float64 or a weight of a wrong shape.
    """
    models = {
        f"{prefix}.onnx": build_model(program, weights, dtype),
        f"{prefix}_rollout.onnx": build_rollout(program, weights, dtype),
    }
    # runtimes refuse a model without results
    if program.states:
        models[f"{prefix}_initial_state.onnx"] = build_initial_state(program, weights, dtype)
    readme = readme_text(
        "onnx",
        model=one_line(program.name),
        prefix=prefix,
        precision=np.dtype(dtype).name,
        has_states=bool(program.states),
    )
    written = [write_bytes(folder / name, _bytes(model)) for name, model in models.items()]
    return (*written, write_text(folder / f"{prefix}_onnx.md", readme))


def _bytes(model: onnx.ModelProto) -> bytes:
    # otherwise protobuf may write maps in any order
    return model.SerializeToString(deterministic=True)
