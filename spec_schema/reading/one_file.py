"""Reads one spec file: text, YAML, schema and expressions, with everything wrong at once."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from pathlib import Path

from pydantic import ValidationError

from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.diagnostics.source import SourceText
from spec_schema.errors import yaml_text as errors
from spec_schema.errors.files import unreadable_file
from spec_schema.late_dataclass import dataclass
from spec_schema.plugins import SCHEMA_LOCK, look_up
from spec_schema.reading.endless_files import refuse_endless
from spec_schema.reading.settings import apply_settings, settings_source
from spec_schema.sections.exports import Export
from spec_schema.sections.layers.layer import Layer
from spec_schema.sections.spec import Spec
from spec_schema.yaml_tree.nodes import Node, Scalar, Table
from spec_schema.yaml_tree.reader import read_tree


@dataclass(frozen=True)
class ReadResult:
    """A spec, or another file that an entry of its `use:` names, such as a robot description."""

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
        """Its text and those of its sub-models, each file once."""
        found = {self.source.path: self.source}
        for used in self.used.values():
            found.update((source.path, source) for source in used.sources)
        return tuple(found.values())


def all_specs(used: Mapping[str, ReadResult]) -> Iterator[Spec]:
    """The specs of sub-models, and of theirs."""
    for read in used.values():
        yield read.spec
        yield from all_specs(read.used)


def read_one_spec(
    path: str | Path, text: str | None = None, settings: Sequence[str] = ()
) -> ReadResult:
    """The spec in a file, or in `text` as if it stood in that file, without its sub-models.

    Raises SpecError with all diagnostics of the first stage that fails: the file, its YAML, its
    schema together with its expressions.
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
    """The keys of a mapping; a lone word means the mapping with that key."""
    if isinstance(node, Table):
        return tuple(node.entries)
    return (node.text,) if isinstance(node, Scalar) and isinstance(node.value, str) else ()


def _is_foreign(key: str, known: Sequence[str]) -> bool:
    return key not in known and not key.startswith("x-")


def read_file(path: Path) -> SourceText:
    """The text of a file as it stands there; SpecError where it is not given or is not UTF-8."""
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
        raise SpecError((errors.not_utf8(readable.span(end, end)),), (readable,)) from error
