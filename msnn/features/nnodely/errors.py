"""E1308-E1317, W1205, W1303-W1309: models of nnodely that are read as specs."""

from __future__ import annotations

from pathlib import Path

from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span


def not_json(file: str, reason: str, label: str, place: Span | None) -> Diagnostic:
    """E1308: the file to import is not JSON, or is too large."""
    repair = "`model.saveModel()` of nnodely 1.x writes the file that is read here"
    shown = Path(file).name or file  # a folder such as `.` has no name
    return error("E1308", place, f"{shown} is no saved model: {reason}", label, help=repair)


def wrong_json(path: str, reason: str, place: Span) -> Diagnostic:
    """E1309: a value of the file does not have the form that nnodely writes."""
    return error("E1309", place, f"`{path}`: {reason}", "this value")


def unknown_name(path: str, name: str, wanted: str, place: Span) -> Diagnostic:
    """E1310: a relation, input, parameter or function is used but not defined in the file."""
    return error(
        "E1310", place, f"`{path}` names `{name}`, which is no {wanted} of the file", "here"
    )


def unfit_shapes(path: str, reason: str, place: Span) -> Diagnostic:
    """E1311: sizes or windows in the file do not match."""
    return error("E1311", place, f"`{path}`: {reason}", "here")


def unknown_relation(path: str, what: str, repair: str, place: Span) -> Diagnostic:
    """E1312: a relation cannot be expressed in a spec."""
    return error("E1312", place, f"`{path}`: {what}", "this relation", help=repair)


def untranslated(path: str, line: str, reason: str, place: Span) -> Diagnostic:
    """E1313: the Python source of a function cannot be translated."""
    notes = (f"the line is `{line}`",) if line else ()
    repair = "code of a file is never run: write the formula as `functions:` of a spec"
    message = f"the function of `{path}` is not translated: {reason}"
    return error("E1313", place, message, "its source", notes=notes, help=repair)


def circle(names: list[str], place: Span) -> Diagnostic:
    """E1314: relations depend on each other within one step."""
    listed = " → ".join(f"`{name}`" for name in names)
    return error("E1314", place, f"relations need each other within one step: {listed}", "here")


def without_values(name: str, place: Span) -> Diagnostic:
    """E1315: the file has no values for a parameter."""
    repair = "call `neuralizeModel` before `saveModel`"
    return error("E1315", place, f"the parameter `{name}` has no values", "here", help=repair)


def file_exists(file: str) -> Diagnostic:
    """E1316: an import would overwrite an existing file."""
    return error("E1316", None, f"{file} exists already", help="name another file by `-o FILE`")


def does_not_compile(reason: str) -> Diagnostic:
    """E1317: the imported model was read, but its spec does not compile."""
    message = "the model is read, but its spec does not compile"
    repair = "where the reason is a limit, make the model smaller; else please report it"
    return error("E1317", None, message, notes=(reason,), help=repair)


def fed_back_late(name: str, samples: int, place: Span) -> Diagnostic:
    """W1303: a closed loop feeds its prediction back late, as nnodely does with future samples."""
    later = f"{samples} sample{'s' if samples > 1 else ''} late"
    message = f"nnodely feeds `{name}` back {later}, since its future is read too, as a target"
    return warning(
        "W1303",
        place,
        message,
        "the window reaches into the future",
        help=f"the spec does the same: write `predicts: {name}[t+1]` if that was not meant",
    )


def nearest_knot(name: str, place: Span) -> Diagnostic:
    """W1304: nnodely interpolates a table by the line of the nearest knot, which jumps."""
    message = f"nnodely goes along the line of the nearest knot of `{name}`, with jumps between"
    repair = "the spec does the same: `interpolation` of the language joins its knots"
    return warning("W1304", place, message, "this table", help=repair)


def renamed(old: str, new: str, place: Span) -> Diagnostic:
    """W1305: a name was changed because specs do not allow it."""
    return warning("W1305", place, f"`{old}` is called `{new}` in the spec", "this name")


def rounded_window(name: str, seconds: float, samples: int, place: Span) -> Diagnostic:
    """W1306: a duration is not a multiple of the sample time."""
    message = f"{seconds:g} s of `{name}` are no whole number of samples; nnodely takes {samples}"
    return warning("W1306", place, message, "here", help="the spec has so many samples too")


def starts_at_zero(name: str, place: Span) -> Diagnostic:
    """W1307: the initial value of a fed-back input cannot be read from the recording."""
    message = f"`{name}` starts at 0: the log does not begin what feeds it back"
    return warning("W1307", place, message, "this input")


def left_out(share: float, name: str, place: Span) -> Diagnostic:
    """W1308: nnodely applies dropout also when it predicts."""
    message = f"nnodely leaves out {share:g} of `{name}` at random when it predicts too"
    repair = "the spec does so in training alone"
    return warning("W1308", place, message, "this relation", help=repair)


def surplus_set(name: str, count: int, place: Span) -> Diagnostic:
    """W1309: nnodely created one more centre of a fuzzy set than it uses."""
    message = f"`{name}` has {count + 1} centres for {count} sets: the last set falls off again"
    repair = "the spec does the same; `linspace` would give the centres that were meant"
    return warning("W1309", place, message, "these centres", help=repair)


def copied(name: str, place: Span) -> Diagnostic:
    """W1205: nnodely shares an array among layers and formulas, but the spec repeats it."""
    message = f"`{name}` is shared in nnodely; the spec has it more than once"
    repair = "all have its values and predict the same; training would move them apart"
    return warning("W1205", place, message, "used in several places", help=repair)
