"""Settings such as `train.0.epochs=5` of the command line, put into the tree before its check."""

from collections.abc import Sequence
from dataclasses import replace

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.errors import settings as errors
from spec_schema.yaml_tree.nodes import Listing, Node, Table, with_key
from spec_schema.yaml_tree.reader import read_tree

SECTIONS = ("data", "train", "validate", "export")
"""What may be set: the workflow. The model itself has one source, the file."""

FILE = "--set"
"""What diagnostics call the file that a setting stands in."""


def settings_source(settings: Sequence[str]) -> SourceText:
    """The settings as a text, one a line, so that diagnostics can point into it."""
    return SourceText(FILE, "\n".join(_as_yaml(setting).replace("\n", " ") for setting in settings))


def apply_settings(root: Node, settings: Sequence[str], findings: Findings) -> Node:
    """The tree with each setting's value at its path: keys, and numbers of list items from 0.

    What is wrong with a setting goes to `findings`. A key that is not there is added; whether it
    may be there is the schema's business.
    """
    text = ""
    for setting in settings:
        # The lines before keep its line number; they are empty so that only this one is read.
        source = SourceText(FILE, text + _as_yaml(setting))
        own = Findings()
        whole = bool(setting.partition("=")[0].strip()) and "=" in setting and "\n" not in setting
        tree = read_tree(source, own) if whole else None
        if isinstance(tree, Table) and len(tree.entries) == 1:
            ((path, value),) = tree.entries.items()
            place = tree.keys[path]
            steps = path.split(".")
            if steps[0] in SECTIONS:
                root = _with(root, steps, value, place, own)
            else:
                own.report(errors.unsettable(path, SECTIONS, place))
        elif not own.failed:
            own.report(errors.malformed_setting(setting, source.span(len(text), len(source.text))))
        findings.report(*own.in_order)
        text += "\n"
    return root


def _as_yaml(setting: str) -> str:
    path, _, value = setting.partition("=")
    return f"{path}: {value}"


def _with(node: Node, steps: Sequence[str], value: Node, place: Span, findings: Findings) -> Node:
    """The node with `value` at the end of the path; unchanged after a report."""
    if not steps:
        return with_key(value, node.key or place)
    step = steps[0]
    match node:
        case Listing(items=items):
            if not step.isdecimal() or int(step) >= len(items):
                findings.report(errors.no_such_item(step, len(items), place))
                return node
            index = int(step)
            item = _with(items[index], steps[1:], value, place, findings)
            return replace(node, items=(*items[:index], item, *items[index + 1 :]))
        case Table(entries=entries, keys=keys):
            key = keys.get(step, place)
            inner = entries.get(step, Table({}, {}, place, key))
            item = _with(inner, steps[1:], value, place, findings)
            return replace(node, entries={**entries, step: item}, keys={**keys, step: key})
        case _:
            # a shorthand such as `rollout: 2 s`: the setting writes the mapping in its place
            return _with(Table({}, {}, place, node.key), steps, value, place, findings)
