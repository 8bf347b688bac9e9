"""Reads a spec, and the sub-models and other files that its `use:` section names.

Each file is read in stages: text, YAML, then schema and expressions together. The SpecError of a
file has all errors of the first stage that fails.
"""

import errno
import os
import stat
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path

from pydantic import ValidationError

from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.diagnostics.source import SourceText
from spec_schema.errors import submodels as submodel_errors
from spec_schema.errors import yaml_text as yaml_errors
from spec_schema.errors.files import unreadable_file
from spec_schema.fields.entry import Entry
from spec_schema.late_dataclass import dataclass
from spec_schema.plugins import SCHEMA_LOCK, look_up
from spec_schema.reading.settings import apply_settings, settings_source
from spec_schema.registry import PartLine
from spec_schema.sections.exports import Export
from spec_schema.sections.layers import Layer
from spec_schema.sections.spec import Spec
from spec_schema.sections.submodels import Use, part_kind
from spec_schema.yaml_tree.nodes import Node, Scalar, Table
from spec_schema.yaml_tree.reader import read_tree

_ENDLESS = {
    stat.S_IFIFO: "it is a pipe, not a file",
    stat.S_IFSOCK: "it is a socket, not a file",
    stat.S_IFCHR: "it is a device, not a file",
    stat.S_IFBLK: "it is a device, not a file",
}
_OF_SYSTEM = {("/", "proc"), ("/", "sys")}


def refuse_endless(path: Path, *, of_shell: bool = False) -> None:
    """Raises OSError for a path that is no file on a disk, or that does not exist.

    These are a pipe, a socket, a device, and files of `/proc` and `/sys`: reading them may never
    end. `of_shell` accepts the pipes in /dev, those of `<(…)` and `/dev/stdin`, into which the
    shell writes.
    """
    kind = stat.S_IFMT(path.stat().st_mode)
    if kind not in _ENDLESS:
        if path.resolve().parts[:2] in _OF_SYSTEM:
            raise OSError(errno.EINVAL, "it is made up by the system", str(path))
        return
    # the shell writes into its own pipes; another one may never be written to
    if of_shell and kind == stat.S_IFIFO and path.parts[1:2] == ("dev",):
        return
    raise OSError(errno.EINVAL, _ENDLESS[kind], str(path))


def is_near(path: str, spec: str) -> bool:
    """True if a file that a spec names is below the folder of the spec or the working folder.

    Messages quote lines of such files only: the spec of another person might name a file with a
    password.
    """
    real = Path(path).resolve()
    # the root of a disk is nobody's folder
    return any(real.is_relative_to(home) for home in _homes(spec) if home.parent != home)


def _homes(spec: str) -> tuple[Path, Path]:
    return Path(spec).parent.resolve(), Path.cwd()


@dataclass(frozen=True)
class ReadResult:
    """A spec with its text, warnings and sub-models, as read.

    It is also used for other files that `use:` names, such as a robot description.
    """

    spec: Spec
    """The spec; for another file, its dims and the parameters that it learns."""
    warnings: tuple[Diagnostic, ...]
    source: SourceText
    """The text of the file, for printing later diagnostics."""
    used: Mapping[str, "ReadResult"] = field(default_factory=dict[str, "ReadResult"])
    """The sub-models of the spec, by their names in `use:`."""
    part: object | None = None
    """The content of another file, such as a robot; None for a spec."""

    @property
    def sources(self) -> tuple[SourceText, ...]:
        """The text of the spec and those of its sub-models, each file once."""
        found = {self.source.path: self.source}
        for used in self.used.values():
            found.update((source.path, source) for source in used.sources)
        return tuple(found.values())


def all_specs(used: Mapping[str, ReadResult]) -> Iterator[Spec]:
    """Yields the specs of sub-models, and those that they use."""
    for read in used.values():
        yield read.spec
        yield from all_specs(read.used)


def read_one_spec(
    path: str | Path, text: str | None = None, settings: Sequence[str] = ()
) -> ReadResult:
    """Reads a spec from a file, or from `text` as the content of that file, without its sub-models.

    `settings` such as `train.0.epochs=5` override values. Raises SpecError with all diagnostics of
    the first stage that fails: the file, its YAML, its schema together with its expressions.
    """
    findings = Findings()
    source = read_file(Path(path)) if text is None else SourceText(str(path), text)
    # A byte order mark is not a character of the text.
    source = SourceText(source.path, source.text.removeprefix("\ufeff"))
    try:
        root = read_tree(source, findings)
        findings.raise_errors()
        if root is not None:
            # the schema cannot change any more while it reads
            if has_foreign_keys(root, settings):
                findings.report(*look_up().warnings)
            # in the tree, before the schema: a value of a setting is checked like one of the file
            root = apply_settings(root, settings, findings)
        findings.raise_errors()
        try:
            with SCHEMA_LOCK:
                spec = Spec.model_validate(root, context=findings)
        except ValidationError:
            # Whatever pydantic refuses was reported where it was refused.
            findings.raise_errors()
            raise
        findings.raise_errors()
    except SpecError as error:
        raise SpecError(error.diagnostics, (source, settings_source(settings))) from None
    return ReadResult(spec, findings.in_order, source)


def has_foreign_keys(root: Node, settings: Sequence[str] = ()) -> bool:
    """True if the spec has, or a setting names, a key that plug-ins may bring and msnn lacks."""
    paths = [tuple(setting.partition("=")[0].strip().split(".")) for setting in settings]
    if isinstance(root, Table):
        paths += [(key,) for key in root.entries]
        paths += [("export", key) for key in _keys(root.entries.get("export"))]
        declared = root.entries.get("layers")
        for layer in declared.entries.values() if isinstance(declared, Table) else ():
            paths += [("layers", "", key) for key in _keys(layer)]
    sections, targets, layers = Spec.known_keys(), Export.known_keys(), Layer.known_keys()
    for path in paths:
        match path:
            case ("export", target, *_):
                foreign = _is_foreign(target, targets)
            case ("layers", _, layer, *_):
                foreign = _is_foreign(layer, layers)
            case _:
                foreign = _is_foreign(path[0], sections)
        if foreign:
            return True
    return False


def _keys(node: Node | None) -> Sequence[str]:
    """The keys of a mapping; a single word counts as a mapping with that key."""
    if isinstance(node, Table):
        return tuple(node.entries)
    return (node.text,) if isinstance(node, Scalar) and isinstance(node.value, str) else ()


def _is_foreign(key: str, known: Sequence[str]) -> bool:
    return key not in known and not key.startswith("x-")


def read_file(path: Path) -> SourceText:
    """The text of a file without any change; SpecError if it cannot be read or is not UTF-8."""
    try:
        refuse_endless(path, of_shell=True)
        content = path.read_bytes()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise SpecError((unreadable_file(str(path), reason),)) from error
    try:
        return SourceText(str(path), content.decode())
    except UnicodeDecodeError as error:
        # up to the byte that is none: the diagnostic shows the line
        readable = SourceText(str(path), content[: error.start].decode())
        end = len(readable.text)
        raise SpecError((yaml_errors.not_utf8(readable.span(end, end)),), (readable,)) from error


MOST_SUBMODELS = 1000
DEEPEST = 16
LARGEST_FILE = 4_000_000
"""Bytes; a text has fewer characters anyway."""


def read_used(
    result: ReadResult,
    texts: Mapping[str, str] | None = None,
    unsaved: Mapping[str, str] | None = None,
) -> Mapping[str, ReadResult]:
    """Reads the sub-models of a spec, and theirs, by the names under which the spec uses them.

    `texts` are contents of all files by path; without it, files are read. `unsaved` are texts that
    replace files by real path, as an editor has them. Raises SpecError with all errors in them;
    each also shows where the file is used.
    """
    path = result.source.path
    return _Reading(path, texts, unsaved or {}).used(result, (path,))


@dataclass()
class _Reading:
    """Reads sub-models once per file, and counts them."""

    root: str
    """The path of the spec that is read for itself."""
    texts: Mapping[str, str] | None
    unsaved: Mapping[str, str]
    read: dict[str, ReadResult] = field(default_factory=dict[str, ReadResult])
    counts: dict[str, int] = field(default_factory=dict[str, int])
    refused: set[str] = field(default_factory=set[str])
    """Files whose mistakes are reported: used again, they are not said again."""

    def used(self, result: ReadResult, chain: tuple[str, ...]) -> Mapping[str, ReadResult]:
        """Reads the sub-models of one spec; `chain` are the files that lead to it, itself
        the last.
        """
        found: dict[str, ReadResult] = {}
        faults: list[Diagnostic] = []
        failed = False
        sources = [result.source]
        count = 1
        for name, use in result.spec.use.items():
            # relative to the file that uses it
            path = os.path.normpath(Path(chain[-1]).parent / use.file.value)
            try:
                if use.part is not None:
                    found[name] = self._part(name, use, use.part, path, result.spec)
                    count += 1
                else:
                    found[name] = self._one(use, path, chain)
                    # a file used again counts again: each use has entries of its own
                    count += self.counts[os.path.realpath(path)]
                if count > MOST_SUBMODELS:
                    limit = f"{MOST_SUBMODELS} sub-models"
                    raise SpecError([submodel_errors.too_many_submodels(limit, use.file.span)])
            except SpecError as error:
                failed = True
                if not is_near(path, self.root) and any(_is_of(d, path) for d in error.diagnostics):
                    faults.append(_unquoted(use, path))
                    continue
                label = f"used here as `{name}`"
                faults += [_seen_from_use(d, use, label) for d in error.diagnostics]
                sources += error.sources
        self.counts[os.path.realpath(chain[-1])] = count
        if failed:
            # a mistake in a file that several parts use is shown once
            raise SpecError(dict.fromkeys(faults), _distinct(sources))
        return found

    def _one(self, use: Use, path: str, chain: tuple[str, ...]) -> ReadResult:
        place = use.file.span
        real = os.path.realpath(path)
        # real paths: a link cannot hide a circle
        files = [os.path.realpath(file) for file in chain]
        if real in files:
            names = [Path(file).name for file in (*chain[files.index(real) :], path)]
            raise SpecError([submodel_errors.uses_itself(names, place)])
        if len(chain) > DEEPEST:
            limit = f"{DEEPEST} sub-models inside each other"
            raise SpecError([submodel_errors.too_many_submodels(limit, place)])
        if real in self.refused:
            # failed as before; what is wrong is reported already
            raise SpecError([])
        if real not in self.read:
            text = self.unsaved.get(real) if self.texts is None else self.texts.get(path)
            reason = "no such file" if self.texts is not None else _why_unreadable(path)
            if text is None and reason is not None:
                raise SpecError([submodel_errors.unreadable_spec(path, reason, place)])
            try:
                result = read_one_spec(path, text)
                self.read[real] = replace(result, used=self.used(result, (*chain, path)))
            except SpecError:
                self.refused.add(real)
                raise
        return self.read[real]

    def _part(
        self, name: str, use: Use, kind: tuple[PartLine, Entry], path: str, around: Spec
    ) -> ReadResult:
        """Reads a part that is no spec, such as a robot; once per use, because settings belong to
        the use.
        """
        line, entry = kind
        part = part_kind(line)
        text = None if self.texts is None else self.texts.get(path)
        if text is None:
            reason = "no such file"
            if self.texts is None:
                reason = _why_unreadable(path, part.largest_file)
            if reason is not None:
                raise SpecError([part.unreadable(path, reason, use.file.span)])
        source = read_file(Path(path)) if text is None else SourceText(path, text)
        findings = Findings()
        found = part.read(entry, source, name, around, findings)
        if found is None:
            raise SpecError(findings.in_order, (source,))
        spec = Spec.model_validate(found.spec, context=findings)
        return ReadResult(spec, findings.in_order, source, part=found.model)


def _why_unreadable(path: str, largest: int = LARGEST_FILE) -> str | None:
    """The reason why a file that a spec names must not be read; None if it may.

    A spec must not be able to name a device, a pipe or a huge file.
    """
    file = Path(path)
    try:
        if not file.exists():
            return "no such file"
        if not file.is_file():
            return "it is not a file"
        refuse_endless(file)
        return "it is too large" if file.stat().st_size > largest else None
    except (OSError, ValueError) as error:
        return (getattr(error, "strerror", None) or str(error)).lower()


def _is_of(diagnostic: Diagnostic, path: str) -> bool:
    """True if a diagnostic points into this file, so that the file could be read."""
    return diagnostic.span is not None and diagnostic.span.file == path


def _unquoted(use: Use, path: str) -> Diagnostic:
    """The diagnostic for a file with errors of which no line may be shown (see `is_near`)."""
    reason = "it has mistakes, and messages quote no file outside of the spec's folder"
    if use.part is not None:
        return part_kind(use.part[0]).unreadable(path, reason, use.file.span)
    repair = f"`msnn check {path}` shows them"
    return submodel_errors.unreadable_spec(path, reason, use.file.span, repair)


def _seen_from_use(diagnostic: Diagnostic, use: Use, label: str) -> Diagnostic:
    """The diagnostic, if it is about another file with the place where that file is used."""
    if diagnostic.span is not None and diagnostic.span.file == use.file.span.file:
        return diagnostic
    return diagnostic.seen_from(use.file.span, label)


def _distinct(sources: list[SourceText]) -> tuple[SourceText, ...]:
    return tuple({source.path: source for source in sources}.values())


def read_spec(
    path: str | Path,
    text: str | None = None,
    settings: Sequence[str] = (),
    *,
    texts: Mapping[str, str] | None = None,
    unsaved: Mapping[str, str] | None = None,
) -> ReadResult:
    """Reads a spec from a `.yaml` or `.json` file, or from `text` as the content of that file.

    `settings` such as `train.0.epochs=5` override values. The files of sub-models are read too;
    with `texts`, these are their contents by path. `unsaved` are texts that replace files by real
    path, as an editor has them. Raises SpecError with all diagnostics of the first stage that
    fails: the file, its YAML, its schema together with its expressions, its sub-models.
    """
    result = read_one_spec(path, text, settings)
    used = read_used(result, texts, unsaved)
    of_parts = (one.warnings for one in used.values() if one.part is not None)
    # nobody checks a URDF by itself; warnings of sub-models come with their own check
    warnings = (*result.warnings, *(warning for each in of_parts for warning in each))
    return replace(result, used=used, warnings=warnings)
