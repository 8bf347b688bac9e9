"""Applies settings such as `train.0.epochs=5` to the tree of a spec before its schema is
checked.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.errors import settings as errors
from spec_schema.fields.entry import Entry, LateEntry, RefusedError
from spec_schema.fields.leaf import Gathering, declarations, members
from spec_schema.registry import SECTIONS
from spec_schema.sections.spec import Spec
from spec_schema.yaml_tree.nodes import Listing, Node, Scalar, Table, with_key
from spec_schema.yaml_tree.reader import read_tree

Kind = Any
"""The type of a field, as pydantic has it: an entry, a mapping or tuple of some, or a leaf."""


def entry_of(kind: Kind) -> type[Entry] | None:
    """The class of an entry of the spec, if a value of this type is one; None for other values."""
    arms = (arm for arm in _arms(kind) if isinstance(arm, type) and issubclass(arm, Entry))
    return next(arms, None)


def inside(kind: Kind, step: str) -> Kind:
    """The type of the value below a key, a name or the index of an item; None if it is unknown."""
    for arm in _arms(kind):
        if isinstance(arm, type) and issubclass(arm, Entry):
            for name, field in arm.model_fields.items():
                # as the user writes it: `from`, `validate`
                if step == (field.alias or name):
                    return field.annotation
            continue
        origin = get_origin(arm)
        # tuples of a spec are homogeneous, `tuple[X, ...]`
        if origin is tuple:
            return get_args(arm)[0]
        if isinstance(origin, type) and issubclass(origin, Mapping):
            return get_args(arm)[1]
    return None


def named_sections(spec: type[Entry]) -> tuple[str, ...]:
    """The sections of the spec whose keys are names that the user chooses, such as `parameters`."""
    return tuple(
        field.alias or name
        for name, field in spec.model_fields.items()
        if any(
            isinstance(m, Gathering) and m.schema in (declarations, members) for m in field.metadata
        )
    )


def _arms(kind: Kind) -> Iterator[Any]:
    """The members of a union type, without annotations; the type itself if it is no union."""
    if get_origin(kind) is Annotated:
        inner, *notes = get_args(kind)
        late = [note.kind for note in notes if isinstance(note, LateEntry)]
        yield from late or _arms(inner)
    elif get_origin(kind) in (Union, UnionType):
        for arm in get_args(kind):
            yield from _arms(arm)
    else:
        yield kind


def workflow() -> tuple[str, ...]:
    """The names of the workflow sections: `data`, `train`, `validate`, `export` and some of
    features.

    All other sections define the model.
    """
    of_features = (line.key for line in SECTIONS if not line.is_model)
    return ("data", "train", "validate", "export", *of_features)


FILE = "--set"
"""What diagnostics call the file that a setting stands in."""


def settings_source(settings: Sequence[str]) -> SourceText:
    """The settings as the lines of one text, so that diagnostics can point into it."""
    return SourceText(FILE, "\n".join(_as_yaml(setting).replace("\n", " ") for setting in settings))


def model_settings(settings: Sequence[str]) -> tuple[str, ...]:
    """The settings that override values of the model, without those of workflow sections."""
    return tuple(s for s in settings if s.partition("=")[0].strip().split(".")[0] not in workflow())


def apply_settings(root: Node, settings: Sequence[str], findings: Findings) -> Node:
    """Sets each setting's value in the tree, at a path of keys and of list items counted from 0.

    Errors go to `findings`. A missing key is added; the schema decides later if it is allowed.
    Names that the model declares are neither added nor removed.
    """
    text = ""
    for setting in settings:
        # The lines before keep its line number; they are empty so that only this one is read.
        source = SourceText(FILE, text + _as_yaml(setting))
        own = Findings()
        # a setting is one line: more would be more than it says
        whole = bool(setting.partition("=")[0].strip()) and "=" in setting and "\n" not in setting
        tree = read_tree(source, own) if whole else None
        if isinstance(tree, Table) and len(tree.entries) == 1:
            ((path, value),) = tree.entries.items()
            place = tree.keys[path]
            changed = _with(root, path.split("."), value, place, own, Spec)
            section = path.partition(".")[0]
            # names of entries are the model: to add or remove one is another model
            if section in named_sections(Spec):
                _refuse_names(path, _names(root, section), _names(changed, section), place, own)
            root = changed
        elif not own.failed:
            own.report(errors.malformed_setting(setting, source.span(len(text), len(source.text))))
        findings.report(*own.in_order)
        text += "\n"
    return root


def _as_yaml(setting: str) -> str:
    path, _, value = setting.partition("=")
    return f"{path}: {value}"


def _names(root: Node, section: str) -> tuple[str, ...]:
    found = root.entries.get(section) if isinstance(root, Table) else None
    return tuple(found.entries) if isinstance(found, Table) else ()


def _refuse_names(
    path: str, before: Sequence[str], after: Sequence[str], place: Span, findings: Findings
) -> None:
    added = [name for name in after if name not in before]
    removed = [name for name in before if name not in after]
    if added or removed:
        findings.report(errors.unsettable(path, added, removed, before, place))


def _with(
    node: Node, steps: Sequence[str], value: Node, place: Span, findings: Findings, kind: Kind
) -> Node:
    """The node in which the value at the path `steps` is `value`; unchanged after reporting an
    error.
    """
    if not steps:
        return with_key(value, node.key or place)
    step = steps[0]
    match node:
        case Listing(items=items):
            # counted from 0, and only those that are there; by one name: `00` would be another one
            if step not in map(str, range(len(items))):
                findings.report(errors.no_such_item(step, len(items), place))
                return node
            index = int(step)
            item = _with(items[index], steps[1:], value, place, findings, inside(kind, step))
            return replace(node, items=(*items[:index], item, *items[index + 1 :]))
        case Table(entries=entries, keys=keys):
            # names of members of sub-models have dots of their own
            # the longest name first: `plant.x` before `plant`
            joined = [".".join(steps[:count]) for count in range(len(steps), 0, -1)]
            step = next((name for name in joined if name in entries), step)
            rest = steps[step.count(".") + 1 :]
            key = keys.get(step, place)
            inner = entries.get(step, Table({}, {}, place, key))
            item = _with(inner, rest, value, place, findings, inside(kind, step))
            return replace(node, entries={**entries, step: item}, keys={**keys, step: key})
        case Scalar():
            written_out = _written_out(node, kind, place, findings)
            return _with(written_out, steps, value, place, findings, kind)


def _written_out(node: Scalar, kind: Kind, place: Span, findings: Findings) -> Table:
    """The mapping that a shorthand means: `{horizon: 2 s}` for `rollout: 2 s`."""
    entry = entry_of(kind)
    if entry is not None and not node.is_empty:
        try:
            canonical = entry.canonical(node, findings)
        except RefusedError:
            canonical = node
        if isinstance(canonical, Table):
            return canonical
    return Table({}, {}, place, node.key)
