"""Reads the specs of sub-models, each file once, with every mistake shown in its own file."""

import os
from collections.abc import Mapping
from dataclasses import field, replace
from pathlib import Path

from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.diagnostics.source import SourceText
from spec_schema.errors import submodels as errors
from spec_schema.fields.entry import Entry
from spec_schema.late_dataclass import dataclass
from spec_schema.reading.endless_files import is_near, refuse_endless
from spec_schema.reading.one_file import ReadResult, read_file, read_one_spec
from spec_schema.registry import PartLine
from spec_schema.sections.part import part_kind
from spec_schema.sections.spec import Spec
from spec_schema.sections.submodels import Use

MOST_SUBMODELS = 1000
DEEPEST = 16
LARGEST_FILE = 4_000_000
"""Bytes; a text has fewer characters anyway."""


def read_used(
    result: ReadResult,
    texts: Mapping[str, str] | None = None,
    unsaved: Mapping[str, str] | None = None,
) -> Mapping[str, ReadResult]:
    """The specs that a spec uses, by the names that it gives them, with those that they use.

    `texts` are the contents of files by their paths; without it they are read, but for those that
    `unsaved` has by their real paths. Raises SpecError with everything that is wrong with any of
    them; beside it stands where the file is used.
    """
    path = result.source.path
    return _Reading(path, texts, unsaved or {}).used(result, (path,))


@dataclass()
class _Reading:
    """Files that are read already, by where they really are, and how many sub-models each is."""

    root: str
    """The path of the spec that is read for itself."""
    texts: Mapping[str, str] | None
    unsaved: Mapping[str, str]
    read: dict[str, ReadResult] = field(default_factory=dict[str, ReadResult])
    counts: dict[str, int] = field(default_factory=dict[str, int])
    refused: set[str] = field(default_factory=set[str])
    """Files whose mistakes are reported: used again, they are not said again."""

    def used(self, result: ReadResult, chain: tuple[str, ...]) -> Mapping[str, ReadResult]:
        """The specs that one uses; `chain` are the files that lead to it, itself the last."""
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
                    raise SpecError([errors.too_many_submodels(limit, use.file.span)])
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
            raise SpecError([errors.uses_itself(names, place)])
        if len(chain) > DEEPEST:
            limit = f"{DEEPEST} sub-models inside each other"
            raise SpecError([errors.too_many_submodels(limit, place)])
        if real in self.refused:
            # failed as before; what is wrong is reported already
            raise SpecError([])
        if real not in self.read:
            text = self.unsaved.get(real) if self.texts is None else self.texts.get(path)
            reason = "no such file" if self.texts is not None else _why_unreadable(path)
            if text is None and reason is not None:
                raise SpecError([errors.unreadable_spec(path, reason, place)])
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
        """Reads a part that is no spec, once for each use, as settings belong to the use."""
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
    """A spec names its parts, so it must not be able to name a device or what has no end."""
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
    """Whether it is about what is in a file, and not about whether it can be read."""
    return diagnostic.span is not None and diagnostic.span.file == path


def _unquoted(use: Use, path: str) -> Diagnostic:
    """What is said of a file with mistakes of which no line may be shown."""
    reason = "it has mistakes, and messages quote no file outside of the spec's folder"
    if use.part is not None:
        return part_kind(use.part[0]).unreadable(path, reason, use.file.span)
    repair = f"`msnn check {path}` shows them"
    return errors.unreadable_spec(path, reason, use.file.span, repair)


def _seen_from_use(diagnostic: Diagnostic, use: Use, label: str) -> Diagnostic:
    """A mistake in another file with the place where that is used; one in this file as it is."""
    if diagnostic.span is not None and diagnostic.span.file == use.file.span.file:
        return diagnostic
    return diagnostic.seen_from(use.file.span, label)


def _distinct(sources: list[SourceText]) -> tuple[SourceText, ...]:
    return tuple({source.path: source for source in sources}.values())
