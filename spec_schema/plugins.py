"""Finds the plug-ins that are installed, and adds what they bring to the tables of the registry.

A plug-in is a package with an entry point of the group `msnn.features`. Entry points are looked up
only when a name is not ours, once in a process: the look-up takes longer than to read a small spec.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager, redirect_stdout
from dataclasses import field
from threading import RLock
from types import FunctionType
from typing import TYPE_CHECKING, Any, cast

from spec_schema import registry
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.diagnostics.source import Span
from spec_schema.errors.plugins import (
    faulty_plugin,
    keep_traceback,
    left_out,
    what_was_raised,
)
from spec_schema.fields.entry import Entry, LateEntry, LateObject, kinds_within
from spec_schema.fields.field_faults import fault_of_fields
from spec_schema.late_dataclass import dataclass
from spec_schema.names import is_name
from spec_schema.registry import Feature, FeatureLines, KeyLine

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "msnn.features"
UNKNOWN_VERSION = "of unknown version"
"""The version of a plug-in whose package has no metadata."""
_ALL = "all"
"""The word of `msnn export --to` for every target of msnn."""
_OF_THE_LANGUAGE = LateObject("compiler.ir.scalars", "OF_THE_LANGUAGE")
"""Names that a function of a plug-in cannot have; the compiler has them, above this room."""
_OF_THE_COMMAND_LINE = LateObject("msnn.cli.application", "VERBS")
"""Names that a verb of a plug-in cannot have."""
_OF_FILES = LateObject("msnn.data.formats.table_of_formats", "SUFFIXES")
"""Suffixes that a format of a plug-in cannot have."""
_SUFFIX = re.compile(r"\.[a-z0-9_-]+")

SCHEMA_LOCK = RLock()
"""Held while the schema of specs changes, and while a spec is validated by it."""


@dataclass(frozen=True, kw_only=True)
class Plugin:
    """A plug-in that is installed and works."""

    package: str
    """As pip installs it."""
    version: str
    feature: Feature
    keys: frozenset[tuple[str, str]]
    """The names that it brings: a kind such as `section`, and a name."""


@dataclass(frozen=True)
class Plugins:
    """The plug-ins of this environment, and warnings about those that are left out."""

    found: tuple[Plugin, ...] = ()
    warnings: tuple[Diagnostic, ...] = ()
    failed: Mapping[str, str] = field(default_factory=dict[str, str])
    """Packages whose plug-in is left out, each with the reason."""
    refused: Mapping[tuple[str, str], tuple[Diagnostic, ...]] = field(
        default_factory=dict[tuple[str, str], tuple[Diagnostic, ...]]
    )
    """Warnings about names that are left out, by kind and name."""
    taken: Mapping[tuple[str, str], tuple[str, ...]] = field(
        default_factory=dict[tuple[str, str], tuple[str, ...]]
    )
    """Packages that bring a name which another package has, by kind and name."""


class _Search:
    """The look-up, which is made once."""

    def __init__(self) -> None:
        self.plugins: Plugins | None = None
        self.added: list[tuple[FeatureLines[Any], KeyLine]] = []


_SEARCH = _Search()


def look_up() -> Plugins:
    """The plug-ins that are installed; the first call imports them."""
    with SCHEMA_LOCK:
        if _SEARCH.plugins is None:
            # a plug-in that reads a spec while it is imported finds no plug-in
            _SEARCH.plugins = Plugins()
            try:
                _SEARCH.plugins = _looked_up()
            except BaseException:  # Ctrl-C
                forget()
                raise
        return _SEARCH.plugins


def known_plugins() -> tuple[Plugin, ...]:
    """The plug-ins found by a look-up; none before one."""
    return () if _SEARCH.plugins is None else _SEARCH.plugins.found


def forget() -> None:
    """Takes out what plug-ins brought, so that the next name that is not ours looks them up again.

    For tests, which install a plug-in while they run.
    """
    with SCHEMA_LOCK:
        for lines, line in reversed(_SEARCH.added):
            lines.remove(line)
        _SEARCH.added.clear()
        for names, _, _ in _NAMES.values():
            names.clear()
        _SEARCH.plugins = None


def plugins_with(names: Collection[tuple[str, str]]) -> tuple[Plugin, ...]:
    """The plug-ins that bring one of these: a kind such as `section`, and a name."""
    return tuple(plugin for plugin in known_plugins() if not plugin.keys.isdisjoint(names))


def no_place(*arguments: object) -> Span | None:
    """No place in the spec."""
    del arguments


def no_fault(value: object, *arguments: object) -> str | None:
    """Accepts every value that a function of a plug-in returns."""
    del value, arguments


@dataclass(frozen=True)
class PluginPart:
    """One name that a plug-in brings, to report mistakes of its functions as the plug-in's."""

    kind: str
    key: str
    module: str
    passing: tuple[type[Exception], ...] = ()
    """Exceptions by which its functions report mistakes of the user, besides SpecError."""

    def fault(self, reason: str, place: Span | None = None) -> SpecError:
        """The error E0230 for a mistake of the plug-in."""
        part = f"the {self.kind} `{self.key}`"
        plugin = next(iter(plugins_with([(self.kind, self.key)])), None)
        package = self.module if plugin is None else f"{plugin.package} {plugin.version}"
        return SpecError([faulty_plugin(package, part, reason, place)])

    def guarded(
        self,
        function: Callable[..., Any],
        fault: Callable[..., str | None] = no_fault,
        place: Callable[..., Span | None] = no_place,
    ) -> Callable[..., Any]:
        """The function, with SpecError for other exceptions and for values that have a `fault`.

        `fault` is asked with the value and the arguments, `place` with the arguments.
        """

        def call(*arguments: Any) -> Any:
            try:
                with prints_to_stderr():
                    value = function(*arguments)
                reason = fault(value, *arguments)
            except SpecError as error:
                reason = fault_of_refusal(error)
                if reason is None:
                    raise
                raise self.fault(reason, place(*arguments)) from error
            except (MemoryError, *self.passing):
                raise
            # a plug-in may fail in any way
            except (Exception, SystemExit) as error:
                reason = what_was_raised(error, self.module)
                raise self.fault(reason, place(*arguments)) from error
            if reason is not None:
                raise self.fault(reason, place(*arguments))
            return value

        return call


def prints_to_stderr() -> AbstractContextManager[object]:
    """Moves what a plug-in prints to standard error: standard output is for results."""
    return redirect_stdout(sys.stderr)


def fault_of_refusal(refusal: SpecError) -> str | None:
    """The reason why a SpecError of a plug-in says nothing to the user; None if it does."""
    if any(found.severity == "error" for found in refusal.diagnostics):
        return None
    keep_traceback(refusal)
    return "raised a SpecError without an error: write `SpecError([error(...)])`"


def is_a(kind: type) -> Callable[..., str | None]:
    """Finds a fault in values of another class."""

    def fault(value: object, *arguments: object) -> str | None:
        del arguments
        if isinstance(value, kind):
            return None
        return f"returned a {type(value).__name__}, not a {kind.__name__}"

    return fault


def _looked_up() -> Plugins:
    from importlib.metadata import entry_points

    # sorted: of two plug-ins that bring one name the same one wins everywhere
    points = sorted(entry_points(group=GROUP), key=lambda point: (_package(point), point.name))
    found: list[Plugin] = []
    warnings: list[Diagnostic] = []
    failed: dict[str, str] = {}
    refused: dict[tuple[str, str], tuple[Diagnostic, ...]] = {}
    taken: dict[tuple[str, str], tuple[str, ...]] = {}
    for point in points:
        package = _package(point)
        try:
            with prints_to_stderr():
                feature = point.load()
            if not isinstance(feature, Feature):
                raise TypeError(f"`{point.value}` is no `msnn.extending.Feature`")
            _check_kinds(feature)
        # a plug-in may fail in any way, and must not keep others from work
        except (Exception, SystemExit) as error:  # noqa: BLE001
            warnings.append(_broken(package, f"the plug-in `{point.name}`", error))
            failed[package] = _reason(error)
            continue
        # a module that fails takes only its own names along
        faults = {id(line): error for line in _all_lines(feature) if (error := _fault(line))}
        keys: set[tuple[str, str]] = set()
        own: list[tuple[str, str, Diagnostic]] = []
        for kind, lines, line in _lines(feature):
            if id(line) in faults:
                fault = _broken(package, f"the {kind} `{line.key}`", faults[id(line)])
                own.append((kind, line.key, fault))
                continue
            reason = _why_not(kind, line.key, package, keys, found)
            if reason is None and not lines.is_free(line.key):
                reason = f"msnn has a {kind} or a word of its own with this name"
            if reason is None:
                lines.add(line)
                _SEARCH.added.append((lines, line))
                keys.add((kind, line.key))
            else:
                own.append((kind, line.key, _without(package, kind, line.key, reason)))
        for kind, key, line in _named(feature):
            if id(line) in faults:
                fault = _broken(package, f"the {kind} `{key}`", faults[id(line)])
                own.append((kind, key, fault))
                continue
            names, ours, is_ours = _NAMES[kind]
            reason = _why_not(kind, key, package, keys, found)
            if reason is None and key in ours.value:
                reason = is_ours
            if reason is None:
                names[key] = line
                keys.add((kind, key))
            else:
                own.append((kind, key, _without(package, kind, key, reason)))
        for kind, key, warning in own:
            if any((kind, key) in plugin.keys for plugin in found):
                taken[kind, key] = (*taken.get((kind, key), ()), package)
            warnings.append(warning)
            refused[kind, key] = (*refused.get((kind, key), ()), warning)
        if faults and not keys:
            failed[package] = _reason(next(iter(faults.values())))
            continue
        version = _metadata(point, "Version") or UNKNOWN_VERSION
        found.append(
            Plugin(package=package, version=version, feature=feature, keys=frozenset(keys))
        )
    return Plugins(tuple(found), tuple(warnings), failed, refused, taken)


def _why_not(
    kind: str, key: str, package: str, keys: Collection[tuple[str, str]], found: Collection[Plugin]
) -> str | None:
    """The reason why a plug-in cannot have a name; None unless it is no name or of a plug-in."""
    if kind == "format" and not _SUFFIX.fullmatch(key):
        return "it is no suffix, which is a dot with lower-case letters and digits"
    # as in other commands, words of a verb's name may have a hyphen between them
    if kind != "format" and not is_name(key.replace("-", "_") if kind == "verb" else key):
        return "it is no name, which has letters, digits and `_`"
    if kind == "target" and key == _ALL:
        return "`all` means every target of msnn"
    owners = [plugin.package for plugin in found if (kind, key) in plugin.keys]
    if package in owners or (kind, key) in keys:
        return "the package brings it twice"
    return f"the package {owners[0]} has this {kind} already" if owners else None


def _without(package: str, kind: str, key: str, reason: str) -> Diagnostic:
    return left_out(package, f"the {kind} `{key}`", reason, f"rename the {kind} in {package}")


def _broken(package: str, part: str, error: BaseException) -> Diagnostic:
    repair = f"install a version of {package} that fits this msnn, or remove it"
    return left_out(package, part, _reason(error), repair)


def _reason(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())


def _package(point: EntryPoint) -> str:
    return _metadata(point, "Name") or point.module.partition(".")[0]


def _metadata(point: EntryPoint, key: str) -> str | None:
    """A value of the package's metadata; None if an incomplete installation does not have it."""
    if point.dist is None:
        return None
    try:
        found = point.dist.metadata
        # a subscript of a missing key is deprecated, and `get` is not in the protocol
        return next(iter(found.get_all(key) or ()), None)
    # Python 3.15 raises an exception of its own for a missing file, older versions do not
    except Exception:  # noqa: BLE001
        return None


_NAMES: dict[str, tuple[dict[str, Any], LateObject, str]] = {
    "function": (registry.FUNCTIONS, _OF_THE_LANGUAGE, "msnn has a function of this name"),
    "verb": (registry.VERBS, _OF_THE_COMMAND_LINE, "msnn has a verb of this name"),
    "format": (registry.FORMATS, _OF_FILES, "msnn reads files of this suffix"),
}
"""By kind: the lines of plug-ins, the names that msnn has, and why one of those is left out."""


def _named(feature: Feature) -> Iterator[tuple[str, str, Any]]:
    for function in feature.functions:
        yield "function", function.key, function
    for verb in feature.verbs:
        yield "verb", verb.key, verb
    for format in feature.formats:
        for suffix in format.suffixes:
            yield "format", suffix, format


def _lines(feature: Feature) -> Iterator[tuple[str, FeatureLines[Any], KeyLine]]:
    for section in feature.sections:
        yield "section", registry.SECTIONS, section
    for target in feature.targets:
        yield "target", registry.TARGETS, target
    for layer in feature.layers:
        yield "layer", registry.LAYERS, layer


_KINDS = {
    "sections": registry.SectionLine,
    "targets": registry.TargetLine,
    "layers": registry.LayerLine,
    "functions": registry.FunctionLine,
    "verbs": registry.VerbLine,
    "formats": registry.FormatLine,
}
"""The class of the lines in each field of a record."""


def _check_kinds(feature: Feature) -> None:
    """Raises TypeError for a line of another kind."""
    for name, kind in _KINDS.items():
        lines: object = getattr(feature, name)
        if not isinstance(lines, tuple) or not all(
            isinstance(line, kind) for line in cast("tuple[object, ...]", lines)
        ):
            raise TypeError(f"`{name}` of its record is no tuple of {kind.__name__}")


def _all_lines(feature: Feature) -> Iterator[object]:
    for name in _KINDS:
        yield from getattr(feature, name)


def _fault(line: object) -> BaseException | None:
    """Imports the objects of a line before a spec is read; returns the exception of a failure."""
    try:
        with prints_to_stderr():
            _import(line)
    except (Exception, SystemExit) as error:  # noqa: BLE001
        return error
    return None


def _import(line: object) -> None:
    """Imports the objects of a line.

    Raises TypeError for an entry that is no `Entry`, and a target of another name than its line. A
    verb must be a function or a `typer.Typer`.
    """
    match line:
        case registry.SectionLine():
            _import_entry(line.entry)
            line.section.value  # noqa: B018
        case registry.TargetLine():
            _import_entry(line.entry)
            if line.target.value.name != line.key:
                raise TypeError(f"the target of the line `{line.key}` has another name")
        case registry.LayerLine():
            _import_entry(line.entry)
            line.rule.value  # noqa: B018
        case registry.FunctionLine():
            line.expand.value  # noqa: B018
        case registry.FormatLine():
            line.read.value  # noqa: B018
        case registry.VerbLine():
            command = line.command.value
            # before typer is imported there is no object of it
            typer = sys.modules.get("typer")
            is_app = typer is not None and isinstance(command, typer.Typer)
            if not isinstance(command, FunctionType) and not is_app:
                raise TypeError(
                    f"the verb of the line `{line.key}` is no function and no typer.Typer"
                )
        case _:
            raise AssertionError(line)


def _import_entry(entry: LateEntry) -> None:
    found: object = entry.value
    if not (isinstance(found, type) and issubclass(found, Entry)):
        raise TypeError(f"`{entry.module}:{entry.name}` is no class with the base Entry")
    # a field whose type is no field type fails here, not at the first spec that has it
    found.model_rebuild(force=True)
    for kind in kinds_within(found):
        fault = fault_of_fields(kind)
        if fault is not None:
            raise TypeError(fault)
