"""E0910-E0924, E0959, E0994, E1047-E1049, E1119, W0902: weights, and their covariance."""

from collections.abc import Sequence
from shlex import quote

from compiler.ir.program import Parameter
from spec_schema.diagnostics.diagnostic import Diagnostic, error, warning
from spec_schema.diagnostics.source import Span
from spec_schema.diagnostics.suggest import nearest

_MOST_SHOWN = 6


def unreadable_weights(file: str, reason: str) -> Diagnostic:
    """E0910: a weights file cannot be read."""
    return error("E0910", None, f"cannot read the weights {file}: {reason}")


def missing_weights(file: str, names: Sequence[str], *, given: bool = False) -> Diagnostic:
    """E0911: weights lack values for parameters of the model."""
    listed = ", ".join(f"`{name}`" for name in names)
    repair = "was it trained with another version of the spec?"
    if given:
        repair = "complete it: `{**msnn.initial_weights(model), **weights}`"
    return error("E0911", None, f"{file} has no values for {listed}", help=repair)


def unknown_weights(file: str, names: Sequence[str], known: Sequence[str]) -> Diagnostic:
    """E0959: weights have names that are not parameters of the model."""
    listed = ", ".join(f"`{name}`" for name in names)
    meant = {name: found for name in names if (found := nearest(name, known))}
    repair = "take the physical values by name, as `result.weights` and `loss.weights()` have them"
    if meant:
        repair = f"did you mean {', '.join(f'`{found}`' for found in meant.values())}?"
    message = f"{file} has {listed}, which the model does not have"
    notes = (f"its parameters: {', '.join(known) or 'none'}",)
    return error("E0959", None, message, notes=notes, help=repair)


def weights_of_another_model(
    file: str, said: Sequence[str], setting: str | None = None, kept: str = "the spec that is kept"
) -> Diagnostic:
    """E0994: weights were trained for another model."""
    # `said` lists the differing values, `setting` is the argument of `--set` that selects the
    # trained model, and `kept` names the file of the run that fits the weights
    more = len(said) - _MOST_SHOWN
    notes = (*said[1:_MOST_SHOWN], *((f"{more} more values differ",) if more > 0 else ()))
    repair = f"train again, or take {kept} beside the weights"
    if setting is not None:
        repair = f"`--set {quote(setting)}` asks for the model that was trained; or train again"
    message = f"{file} was trained for another model: {said[0]}"
    return error("E0994", None, message, notes=notes, help=repair)


def misshapen_weights(
    file: str, name: str, found: Sequence[int], expected: Sequence[int], span: Span | None
) -> Diagnostic:
    """E0912: an array of weights has another shape than its parameter."""
    message = f"`{name}` in {file} has shape {_shape(found)}, not {_shape(expected)}"
    return error("E0912", span, message, "declared here" if span else "")


def weights_not_finite(file: str, names: Sequence[str]) -> Diagnostic:
    """E0923: weights contain NaN or infinite values."""
    listed = ", ".join(f"`{name}`" for name in names)
    return error("E0923", None, f"{file} has values that are not finite in {listed}")


def weights_not_floating(file: str, name: str, kind: str) -> Diagnostic:
    """E0924: an array of weights has integers or truth values instead of floating-point numbers."""
    message = f"`{name}` in {file} holds {kind} values, not floating point numbers"
    return error("E0924", None, message, help="write the array as float64")


def weights_outside_bounds(file: str, parameter: Parameter, found: float) -> Diagnostic:
    """E1119: a weight is outside the bounds that the spec sets for it."""
    name, low, high = parameter.name, parameter.minimum, parameter.maximum
    ends = [f"at least {low:g}"] * (low is not None) + [f"at most {high:g}"] * (high is not None)
    message = f"`{name}` in {file} is {found:g}, and the spec wants {' and '.join(ends)}"
    repair = "train with these bounds, or widen `min` and `max`"
    return error("E1119", parameter.span, message, "its bounds", help=repair)


def moved_off_bound(names: Sequence[str]) -> Diagnostic:
    """W0902: initial values were moved off bounds, where the optimiser could not change them."""
    listed = ", ".join(f"`{name}`" for name in names)
    message = f"moved off their bounds to be trainable: {listed}"
    repair = "train with `levenberg_marquardt`, which begins on a bound, or begin farther inside"
    return warning("W0902", None, message, help=repair)


def _shape(shape: Sequence[int]) -> str:
    return "×".join(map(str, shape)) or "scalar"


def no_covariance(why: str) -> Diagnostic:
    """E1047: prediction intervals are requested, but the uncertainty of the weights is unknown."""
    message = f"there are no prediction intervals: {why}"
    repair = "take the weights of a whole training, with the folder of its run or its result"
    return error("E1047", None, message, help=repair)


def no_training_rows(output: str | None, why: str) -> Diagnostic:
    """E1048: prediction intervals are requested, but no training rows show how large errors are."""
    of = "" if output is None else f" of `{output}`"
    message = f"there are no prediction intervals{of}: {why}"
    repair = "how large errors are is measured on the set `train`: data without it do not tell"
    return error("E1048", None, message, help=repair)


def nothing_to_band(outputs: Sequence[str]) -> Diagnostic:
    """E1049: prediction intervals are requested for outputs that predict no signal."""
    listed = ", ".join(f"`{name}`" for name in outputs)
    message = f"no output of {listed} predicts a signal: what it errs by is not known"
    repair = 'say what an output predicts: `y: {expr: …, predicts: "x[t+1]"}`'
    return error("E1049", None, message, help=repair)
