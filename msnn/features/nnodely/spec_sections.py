"""Assembles the sections of a spec from an evaluated model."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from msnn.features.nnodely.functions import Functions
from msnn.features.nnodely.layers import Layers
from msnn.features.nnodely.names import TakenNames
from msnn.features.nnodely.parameters import Parameters
from msnn.features.nnodely.saved_model import File
from msnn.features.nnodely.signals import Signals
from msnn.features.nnodely.terms import (
    ATOM,
    Call,
    Infix,
    Term,
    after_operands,
    number_text,
    text_of,
)

_LONGEST = 120
"""Maximum characters of a text within another one."""
_LONGEST_ENTRY = 3000
"""Maximum characters of an entry, below the limit of the parser."""
_LONGEST_NAME = 8
"""Minimum characters of an operand that is worth an equation."""


@dataclass(slots=True, kw_only=True)
class Equations:
    """Writes terms as texts of the spec; parts that are used repeatedly or are long become
    equations, in `texts` by name.
    """

    names: TakenNames
    hints: Mapping[int, str]
    """Names of terms, by identity."""
    texts: dict[str, str] = field(default_factory=dict[str, str])
    _written: dict[int, tuple[str, int]] = field(default_factory=dict[int, "tuple[str, int]"])
    _uses: dict[int, int] = field(default_factory=dict[int, int])

    def count(self, roots: Iterable[Term]) -> None:
        """Counts how often parts of these terms are used; to be called before any text
        is written.
        """
        seen: set[int] = set()
        for root in roots:
            self._uses[id(root)] = self._uses.get(id(root), 0) + 1
            for node in after_operands(root, lambda one: id(one) in seen):
                seen.add(id(node))
                for arg in node.args:
                    self._uses[id(arg)] = self._uses.get(id(arg), 0) + 1

    def name(self, term: Term, name: str) -> None:
        """Gives a term a name in the spec, by which other texts refer to it. The first name stays;
        terms without operands get none.
        """
        if term.args and id(term) not in self._written:
            self._written[id(term)] = (name, ATOM)

    def is_named(self, term: Term, name: str) -> bool:
        """True if others refer to this term by that name."""
        return self._written.get(id(term), ("", 0))[0] == name

    def text(self, root: Term, *, entry: str | None = None) -> str:
        """The text of a term: its name if it has one, else its formula. For the entry that defines
        it, whose name is `entry`, always the formula.
        """
        for arg in root.args:
            for node in after_operands(arg, lambda one: id(one) in self._written):
                self._written[id(node)] = self._shared(node)
        text = self._text_of(root)
        if entry is not None:
            return text[0]
        if id(root) not in self._written:
            self._written[id(root)] = self._shared(root)
        return self._written[id(root)][0]

    def _shared(self, node: Term) -> tuple[str, int]:
        text = self._text_of(node)
        # a comparison is no value in the language: it may stand in a `where` alone
        is_condition = isinstance(node.head, Infix) and node.head.sign[0] in "<>"
        used_often = self._uses.get(id(node), 1) > 1 and len(text[0]) > 12
        if not node.args or is_condition or not (used_often or len(text[0]) > _LONGEST):
            return text
        # a concatenation has no dimension of its own, which an equation would need
        if isinstance(node.head, Call) and node.head.name == "concat":
            return text
        return self._named(node, text[0])

    def _text_of(self, node: Term) -> tuple[str, int]:
        """The text of a term and its precedence. If it is too long, its longer operands become
        equations.
        """
        text = text_of(node, [self._written[id(arg)] for arg in node.args])
        if len(text[0]) <= _LONGEST_ENTRY:
            return text
        for arg in node.args:
            inner = self._written[id(arg)][0]
            if arg.args and len(inner) > _LONGEST_NAME:
                # told by identity: equal terms of two places may have other names
                self._written[id(arg)] = self._named(arg, inner)
        return text_of(node, [self._written[id(arg)] for arg in node.args])

    def _named(self, node: Term, text: str) -> tuple[str, int]:
        name = self.names.free(self.hints.get(id(node), "e"))
        self.texts[name] = text
        return name, ATOM


@dataclass(frozen=True, slots=True, kw_only=True)
class Sections:
    """Everything that was translated of a model, from which the spec is assembled. Losses are
    (kind, term, term).
    """

    name: str
    file: File
    names: TakenNames
    parameters: Parameters
    layers: Layers
    functions: Functions
    signals: Signals
    equations: Equations
    outputs: Mapping[str, Term]
    held: Mapping[str, Term]
    losses: Mapping[str, tuple[str, Term, Term]]


def spec_values(found: Sections) -> dict[str, Any]:
    """The spec as mappings, lists, texts and numbers, by section in reading order; empty sections
    are left out.
    """
    equations, signals = found.equations, found.signals
    predictors, added = _predictors(found)
    outputs = {found.names.of("output", old): term for old, term in found.outputs.items()}
    outputs |= added
    closings = {name: term for name, (term, _) in signals.states.items()}
    losses = [term for _, *sides in found.losses.values() for term in sides]
    # all uses are counted before a text is written: what is used twice becomes an equation
    equations.count([*outputs.values(), *found.held.values(), *signals.equations.values()])
    degrees = [term for one in found.layers.declared.values() for term in _degrees(one)]
    equations.count([*closings.values(), *losses, *degrees])
    # named before anything is written: who uses the same term then writes the name
    for name, term in [*found.held.items(), *signals.equations.items(), *outputs.items()]:
        equations.name(term, name)
    held = {name: equations.text(term, entry=name) for name, term in found.held.items()}
    kept = {
        name: {"expr": equations.text(term, entry=name), "history": 0}
        for name, term in signals.equations.items()
    }
    written = {
        name: _output(_entry_text(equations, outputs, name), predictors.get(name))
        for name in outputs
    }
    states = {
        name: _state(found, equations.text(term), size)
        for name, (term, size) in signals.states.items()
    }
    scored = {
        found.names.free(old): f"{loss}({equations.text(a)}, {equations.text(b)})"
        for old, (loss, a, b) in found.losses.items()
    }
    functions = {
        name: {"args": list(formula.args), "expr": formula.text}
        for name, formula in found.functions.declared.items()
    }
    layers = {n: _layer(equations, settings) for n, settings in found.layers.declared.items()}
    inputs = {n: _signal(found, s) for n, s in _named(found, signals.inputs)}
    targets = {n: _signal(found, s) for n, s in _named(found, signals.targets) if n not in inputs}
    sections = {
        "msnn": 1,
        "name": found.name,
        "sample_time": f"{number_text(float(found.file.Info.SampleTime))} s",
        "dims": found.parameters.dims.section(),
        "inputs": inputs,
        "targets": targets,
        "constants": found.parameters.fixed,
        "parameters": found.parameters.declared,
        "layers": layers,
        "functions": functions,
        "states": states,
        "equations": {**equations.texts, **held, **kept},
        "outputs": written,
        "losses": scored,
    }
    # a spec has inputs, if only none
    return {key: value for key, value in sections.items() if value != {} or key == "inputs"}


def _degrees(settings: dict[str, Any]) -> list[Term]:
    """The memberships by which a local model weighs its cells; empty for other layers."""
    return settings.get("local_model", {}).get("by", [])


def _layer(equations: Equations, settings: dict[str, Any]) -> dict[str, Any]:
    if "local_model" not in settings:
        return settings
    by = [equations.text(term) for term in _degrees(settings)]
    local = {**settings["local_model"], "by": by if len(by) > 1 else by[0]}
    return {"local_model": local}


def _entry_text(equations: Equations, outputs: Mapping[str, Term], name: str) -> str:
    """The formula of the output `name`, or the name of an earlier output or equation that is the
    same term.
    """
    term = outputs[name]
    first = next((n for n, other in outputs.items() if other is term), name)
    # of two outputs that are the same term the first has the formula
    own = first == name and equations.is_named(term, name)
    return equations.text(term, entry=name) if own or not term.args else equations.text(term)


def _predictors(found: Sections) -> tuple[dict[str, str], dict[str, Term]]:
    """For each fed-back input the output that predicts it: `predicts` of these outputs by name, and
    the outputs that had to be added.
    """
    predictors: dict[str, str] = {}
    added: dict[str, Term] = {}
    for old, ahead in found.signals.predicted.items():
        new = found.names.of("input", old)
        source = found.file.Inputs[old].closed_loop
        target = f"{new}[t+{ahead}]"
        for output, relation in found.file.Outputs.items():
            name = found.names.of("output", output)
            if relation == source and name not in predictors:
                predictors[name] = target
                break
        else:
            assert source is not None
            name = found.names.free(f"{new}_next")
            predictors[name] = target
            value = found.functions.values.whole(found.signals.value_of(source))
            added[name] = value
    return predictors, added


def _output(text: str, predicts: str | None) -> Any:
    return text if predicts is None else {"expr": text, "predicts": predicts}


def _state(found: Sections, text: str, size: int) -> dict[str, Any]:
    dims = {} if size == 1 else {"dims": found.parameters.dims.of(size)}
    return {"next": text, "history": 0, **dims}


def _named(found: Sections, signals: Mapping[str, int]) -> Iterator[tuple[str, int]]:
    return ((found.names.of("input", old), size) for old, size in signals.items())


def _signal(found: Sections, size: int) -> dict[str, Any]:
    return {} if size == 1 else {"dims": found.parameters.dims.of(size)}
