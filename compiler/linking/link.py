"""Joins a spec and its sub-models to one spec in which every entry has its full name, such as
`vehicle.mass` (rule R11 of the language).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import field, replace
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Annotated, Any, Generic, TypeVar

from pydantic import PlainValidator

from compiler.ir.scalars import Array
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import submodels as errors
from spec_schema.errors.names import no_parameter
from spec_schema.fields.entry import Entry
from spec_schema.late_dataclass import dataclass
from spec_schema.reading.reader import ReadResult
from spec_schema.registry import PartLine
from spec_schema.sections.data import Data
from spec_schema.sections.signals import Equation, Output, Signal
from spec_schema.sections.spec import Integrator, Spec
from spec_schema.sections.submodels import Connection, Use
from spec_schema.sections.values import Dimension

if TYPE_CHECKING:
    from compiler.linking.renaming import Renaming


class Connected(Equation):
    """An equation that replaces an input of a sub-model: a connected input. It has the unit and the
    dimensions that the input declares.

    `input` is that declaration. `declared_in` is the sub-model whose file contains the connection,
    "" for the model itself.
    """

    input: Annotated[Any, PlainValidator(lambda signal: signal)]
    declared_in: str

    @property
    def feeds(self) -> Signal:
        """The declaration of the input that the equation replaces."""
        assert isinstance(self.input, Signal)
        return self.input

    def is_held_for(self, owner: str) -> bool:
        """True if the value is constant while an integrator steps the states of the sub-model
        `owner` (R6).

        A connection in a file outside `owner` is evaluated once, at sample t. One in the file of
        `owner` or of its sub-models is evaluated at every integrator stage. `owner` is "" for the
        model itself.
        """
        inside = not owner or self.declared_in == owner
        return not (inside or self.declared_in.startswith(f"{owner}."))


WeightsByPart = Mapping[str, Mapping[str, Array]]
"""For each sub-model that has `weights:`, its arrays by the names of its own file."""


M_co = TypeVar("M_co", covariant=True)


@dataclass(frozen=True)
class LinkedPart(Generic[M_co]):
    """A part that is no spec: a component from another kind of file that a feature reads, such as a
    robot.
    """

    name: str
    line: PartLine
    model: M_co
    """The data of the part, read from its file and its entry in the spec."""
    names: Mapping[str, str]
    """The full names of the part's dims and parameters, by their names within the part."""


@dataclass(frozen=True)
class Linked:
    """The spec of the whole model with full names, and facts about its sub-models that are no
    entries of a spec.
    """

    spec: Spec
    """The joined spec. Its `use` has the sub-models of sub-models too; connected inputs are
    equations."""
    integrators: Mapping[str, Integrator | None]
    """The integrator of the continuous states of the model ("") and of each sub-model; None means
    the default."""
    files: Mapping[str, ReadResult] = field(default_factory=dict[str, ReadResult])
    """The parsed file of each sub-model, by full name."""
    weights: WeightsByPart = field(default_factory=dict[str, Mapping[str, Array]])
    numbers: Mapping[str, str] = field(default_factory=dict[str, str])
    """Contents of files of initial values that were read before, by path."""
    parts: Mapping[str, LinkedPart[object]] = field(default_factory=dict[str, LinkedPart[object]])
    """The parts that are no specs, such as robots, by full name."""


def link(
    spec: Spec, used: Mapping[str, ReadResult], weights: WeightsByPart, findings: Findings
) -> Linked:
    """Joins a spec and its sub-models to one spec in which every name is a full name
    (`vehicle.mass`).

    `used` has the parsed files of sub-models and `weights` their arrays, by full name of the
    sub-model. Mistakes of the user go to `findings`. Losses, data, training, validation, exports
    and `predicts` of sub-models are dropped: they describe how a sub-model was trained. Raises
    ValueError if `used` lacks a sub-model.
    """
    if not spec.use:
        return Linked(spec, {"": spec.integrator})
    if set(spec.use) != set(used):
        message = "a spec with sub-models is compiled from its file: msnn.load(path)"
        raise ValueError(message)
    linking = _Linking(findings)
    whole = linking.part(spec, used, "", ())
    # when all parts are there: a connection can feed any sub-model within a sub-model
    linking.connect(whole.sections)
    sections = {**whole.sections, "dims": linking.dims, "use": linking.use}
    linked = spec.model_copy(update=sections)
    return Linked(linked, linking.integrators, linking.files, weights, parts=linking.parts)


MODEL_SECTIONS = (
    "inputs",
    "targets",
    "constants",
    "parameters",
    "layers",
    "functions",
    "states",
    "equations",
    "outputs",
)
"""Sections whose entries have names that expressions use, except `dims`."""
_Dims = Mapping[str, tuple[str, Dimension]]
"""Dimensions of a spec: for each name in the spec, the full name and the declaration."""


@dataclass(frozen=True)
class _Part:
    """The sections of a spec joined with those of its sub-models, and the full name of each name
    that the spec uses.
    """

    sections: dict[str, Any]
    names: Mapping[str, str]


class _Linking:
    """Links specs recursively, and collects the sections of the whole spec meanwhile."""

    def __init__(self, findings: Findings) -> None:
        self.findings = findings
        self.dims: dict[str, Dimension] = {}
        self.use: dict[str, Use] = {}
        self.integrators: dict[str, Integrator | None] = {}
        self.files: dict[str, ReadResult] = {}
        self.connections: list[tuple[str, Connection, str]] = []
        self.parts: dict[str, LinkedPart[object]] = {}

    def part(
        self, spec: Spec, used: Mapping[str, ReadResult], prefix: str, around: tuple[_Dims, ...]
    ) -> _Part:
        """Links one spec with its sub-models, recursively. `used` has the parsed files of its
        sub-models, `prefix` is the start of its full names (`vehicle.`, "" for the model itself).
        `around` are the dimensions of the specs that use it, the nearest first.
        """
        owner = prefix.removesuffix(".")
        self.integrators[owner] = spec.integrator
        dims = self._dims(spec, prefix, around)
        names = {name: full for name, (full, _) in dims.items()}
        names |= {
            name: prefix + name for section in MODEL_SECTIONS for name in getattr(spec, section)
        }
        inner: list[_Part] = []
        for name, use in spec.use.items():
            full, file = prefix + name, used[name]
            self.use[full], self.files[full] = use, file
            self._compare_sample_times(full, use, spec, file.spec)
            part = self.part(file.spec, file.used, f"{full}.", (dims, *around))
            # every name of a sub-model is known here too, with the sub-model's name in front
            names |= {f"{name}.{member}": known for member, known in part.names.items()}
            if use.part is not None:
                self.parts[full] = LinkedPart(full, use.part[0], file.part, part.names)
            inner.append(part)
        # few specs have sub-models, and it knows the settings of layers
        from compiler.linking.renaming import Renaming

        renaming = Renaming(prefix, names)
        self.connections += [
            (renaming.name(name), renaming.entry(connection), owner)
            for name, connection in spec.connect.items()
        ]
        sections: dict[str, Any] = {
            section: {
                prefix + name: renaming.entry(_opened(entry) if prefix else entry)
                for name, entry in getattr(spec, section).items()
            }
            for section in MODEL_SECTIONS
        }
        for part in inner:
            for section, entries in part.sections.items():
                sections[section] |= entries
        # sections of the whole model alone: those of sub-models say how these were made
        if not prefix:
            sections["losses"] = {name: renaming.entry(e) for name, e in spec.losses.items()}
            if spec.data is not None:
                sections["data"] = _with_full_names(spec.data, renaming)
            for line, entry in spec.sections():
                sections[line.key] = renaming.entry(entry)
        return _Part(sections, names)

    def connect(self, sections: dict[str, dict[str, Any]]) -> None:
        """Replaces every connected input of a sub-model in `sections` by an equation with the
        connected expression. Reports a second connection of an input, and names that are no inputs.
        """
        inputs, equations = sections["inputs"], sections["equations"]
        first: dict[str, Connection] = {}
        # a dot says that a name is of a sub-model; inputs of the whole model are fed by its user
        known = [name for name in inputs if "." in name]
        for name, connection, owner in self.connections:
            place = connection.place.key
            if name in first:
                self.findings.report(errors.fed_twice(name, place, first[name].place.key))
                continue
            signal = inputs.get(name)
            if not isinstance(signal, Signal):
                kind = self._kind(name, sections)
                self.findings.report(errors.not_an_input(name, kind, place, known))
                continue
            first[name] = connection
            equations[name] = Connected.model_construct(
                place=connection.place,
                expr=connection.expr,
                unit=signal.unit,
                history=connection.history,
                doc=connection.doc or signal.doc,
                input=signal,
                declared_in=owner,
            )
        sections["inputs"] = {n: entry for n, entry in inputs.items() if n not in first}

    def _kind(self, name: str, sections: Mapping[str, Mapping[str, Any]]) -> str | None:
        """For a message, the kind of the entry `name`, which is no input of a sub-model, such as "a
        sub-model"; None if `sections` have no such entry.
        """
        if name in self.use:
            return "a sub-model"
        return next((f"one of its {s}" for s in MODEL_SECTIONS if name in sections[s]), None)

    def _dims(self, spec: Spec, prefix: str, around: tuple[_Dims, ...]) -> _Dims:
        """For each dimension of a spec, its full name, with `prefix` in front, and its declaration.
        A dimension that a spec in `around` declares identically is shared and keeps the name that
        it has there.
        """
        found: dict[str, tuple[str, Dimension]] = {}
        for name, dimension in spec.dims.items():
            outer = next((dims[name] for dims in around if name in dims), None)
            if outer is not None and _is_same(outer[1], dimension):
                full = outer[0]
                # the spec around may leave labels out that a sub-model gives
                labels = self.dims[full].labels or dimension.labels
                self.dims[full] = replace(self.dims[full], labels=labels)
            else:
                full = prefix + name
                self.dims[full] = dimension
            found[name] = full, dimension
        return found

    def _compare_sample_times(self, part: str, use: Use, spec: Spec, inner: Spec) -> None:
        # two sub-models without a sample time agree as well
        expected, found = (s.sample_time.value if s.sample_time else None for s in (spec, inner))
        # a window of so many samples would mean another time: nothing is resampled between models
        if expected != found:
            place = use.file.span
            declared = inner.sample_time.span if inner.sample_time else inner.name.span
            report = errors.other_sample_time(part, _rate(found), _rate(expected), place, declared)
            self.findings.report(report)


def _opened(entry: Entry) -> Entry:
    """An entry of a sub-model. An output loses its `predicts`, which only concerns the training of
    the sub-model.
    """
    is_output = isinstance(entry, Output)
    return entry.model_copy(update={"predicts": None}) if is_output else entry


def _with_full_names(data: Data, renaming: Renaming) -> Data:
    """The data section with the full names of `renaming`; only its filters contain names of the
    spec.
    """
    sources = {
        name: source.model_copy(update={"filter": renaming.entry(source.filter)})
        for name, source in data.source.items()
    }
    return data.model_copy(update={"source": sources, "filter": renaming.entry(data.filter)})


def _is_same(outer: Dimension, inner: Dimension) -> bool:
    """True if two dimensions of the same name can be one: they have the same size, and the same
    labels unless one has none.
    """
    labels = not outer.labels or not inner.labels or outer.labels == inner.labels
    return outer.size == inner.size and labels


def _rate(seconds: float | None) -> str:
    return "no sample time" if seconds is None else f"a sample time of {seconds:.9g} s"


class GivenWeights:
    """The parameter values from the files that `weights:` of sub-models name, and the parameters
    that `freeze:` makes constant, by full name.
    """

    def __init__(self, linked: Linked, findings: Findings) -> None:
        self._use = linked.spec.use
        self._files = linked.files
        self._weights = linked.weights
        self._findings = findings
        self._missing: dict[str, list[str]] = {}

    def value(self, name: str, shape: tuple[int, ...]) -> Array | None:
        """The array of the parameter `name` from the weights of a sub-model that contains it, the
        outermost one first. None if no weights have it, or if its shape is not `shape`, which is
        reported.
        """
        owners = list(self._owners(name))
        for index, owner in enumerate(owners):
            own = name.removeprefix(f"{owner}.")
            arrays = self._weights.get(owner)
            # without `weights:` of its own a sub-model has those that its parent may give
            if arrays is None:
                continue
            if own in arrays:
                return self._fitting(owner, own, arrays[own], shape)
            # a sub-model further in that is frozen has its values in its own weights, not in these
            if not self._freezes(owners[index + 1 :], name):
                self._missing.setdefault(owner, []).append(own)
                return None
        return None

    def is_frozen(self, name: str) -> bool:
        """True if `freeze:` of a sub-model that contains the parameter `name` makes it a
        constant.
        """
        return self._freezes(self._owners(name), name)

    def settles(self, name: str) -> bool:
        """True if the weights of a sub-model contain the parameter `name`, or if it is frozen."""
        return self.is_frozen(name) or any(
            name.removeprefix(f"{owner}.") in self._weights.get(owner, {})
            for owner in self._owners(name)
        )

    def report(self, names: Iterable[str]) -> None:
        """Reports weights that lack a parameter or have unknown arrays, and patterns of `freeze:`
        that match no parameter. `names` are the full names of all parameters of the model.
        """
        names = tuple(names)
        for part, missing in self._missing.items():
            listed = ", ".join(f"`{name}`" for name in missing)
            problem = f"no values for {listed}"
            repair = "were they trained with another version of its spec?"
            place = self._place(part)
            self._findings.report(errors.unusable_weights(part, problem, place, repair))
        for part, arrays in self._weights.items():
            spec = self._files[part].spec
            # by the first word: arrays of layers and of inner sub-models have a dot
            known = {*spec.parameters, *spec.layers, *spec.use}
            extra = sorted(name for name in arrays if name.partition(".")[0] not in known)
            if extra:
                listed = ", ".join(f"`{name}`" for name in extra)
                problem = f"its spec declares no {listed}"
                repair = "were they trained with another version of its spec?"
                self._findings.report(
                    errors.unusable_weights(part, problem, self._place(part), repair)
                )
        for part, use in self._use.items():
            own = [n.removeprefix(f"{part}.") for n in names if n.startswith(f"{part}.")]
            for pattern in use.freeze.patterns:
                # `*` also suits a sub-model without parameters
                if pattern.value != "*" and not any(fnmatchcase(n, pattern.value) for n in own):
                    report = no_parameter(pattern.value, pattern.span, own)
                    self._findings.report(report)

    # ---- inside

    def _owners(self, name: str) -> Iterator[str]:
        """The sub-models that contain the entry `name`, the outermost first: `car`, `car.tire` for
        `car.tire.mu`.
        """
        parts = name.split(".")
        for count in range(1, len(parts)):
            owner = ".".join(parts[:count])
            if owner in self._use:
                yield owner

    def _freezes(self, owners: Iterable[str], name: str) -> bool:
        return any(
            fnmatchcase(name.removeprefix(f"{owner}."), pattern.value)
            for owner in owners
            for pattern in self._use[owner].freeze.patterns
        )

    def _fitting(self, part: str, own: str, array: Array, shape: tuple[int, ...]) -> Array | None:
        if array.shape == shape:
            return array
        problem = f"`{own}` has the shape {list(array.shape)}, not {list(shape)}"
        place = self._place(part)
        self._findings.report(errors.unusable_weights(part, problem, place, None))
        return None

    def _place(self, part: str) -> Span:
        use = self._use[part]
        return use.weights.span if use.weights is not None else use.place.key
