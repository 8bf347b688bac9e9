"""Turns a Program into plain data for its file."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import PurePath

from compiler.ir.program import Program
from compiler.program_file.fields import Data, Shared, to_data

FORMAT = 1
"""Version of the file; readers refuse another one."""


def program_to_data(program: Program) -> Data:
    """Dictionaries, lists, strings and numbers from which `program_from_data` makes it again.

    Numbers keep every bit, units are written by their text, places by the name of their file
    without its folder, unless two files have one name. What has its default value is left out.
    """
    names = _names_of_files(program)
    shared = Shared(tuple(names.values()), numbers={path: i for i, path in enumerate(names)})
    data: Data = {
        "format": FORMAT,
        "name": program.name,
        "doc": program.doc,
        "spec_hash": program.spec_hash,
        "sample_time": program.sample_time,
        "files": list(shared.files),
        "dimensions": [to_data(dimension, shared) for dimension in program.dimensions],
        "signals": [to_data(signal, shared) for signal in program.signals],
        "parameters": [to_data(parameter, shared) for parameter in program.parameters],
        "states": [to_data(state, shared) for state in program.states],
        "start": [to_data(node, shared) for node in program.start.nodes],
        "step": [to_data(node, shared) for node in program.step.nodes],
        "outputs": [to_data(output, shared) for output in program.outputs],
        "losses": [to_data(loss, shared) for loss in program.losses],
    }
    if program.expected:
        data["expected"] = [to_data(entry, shared) for entry in program.expected]
    if program.fits:
        data["fits"] = [to_data(fit, shared) for fit in program.fits]
    if program.formulas:
        data["formulas"] = [to_data(formula, shared) for formula in program.formulas]
    if program.plugins:
        data["plugins"] = [to_data(plugin, shared) for plugin in program.plugins]
    return data


def _names_of_files(program: Program) -> dict[str, str]:
    """The shortest ends of the paths of all specs in which no two are the same, by path."""
    spans = [node.span for graph in (program.start, program.step) for node in graph.nodes]
    for declared in (program.signals, program.parameters, program.states):
        spans += [item.span for item in declared]
    for declared in (program.outputs, program.losses, program.expected, program.formulas):
        spans += [item.span for item in declared]
    parts = {span.file: PurePath(span.file).parts for span in spans if span is not None}
    return {path: "/".join(own[-_length(own, parts.values()) :]) for path, own in parts.items()}


def _length(own: tuple[str, ...], every: Iterable[tuple[str, ...]]) -> int:
    """The number of last parts of a path that tell it from the others."""
    others = [parts for parts in every if parts != own]
    lengths = range(1, len(own) + 1)
    return next((n for n in lengths if all(p[-n:] != own[-n:] for p in others)), len(own))
