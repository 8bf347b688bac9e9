"""Checks the options of `optimizer: {torch: NAME}` without importing torch.

A test compares the table with the installed torch.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from compiler.ir.program import Parameter
from msnn.errors.learning import stages as errors
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.sections.optimizers import OptionValue, TorchOptimizer


@dataclass(frozen=True, slots=True, kw_only=True)
class NumberLimits:
    """The allowed values of a numeric option: least ≤ number ≤ most, above < number < below."""

    least: float = -math.inf
    most: float = math.inf
    above: float = -math.inf
    below: float = math.inf
    whole: bool = False
    or_none: bool = False


Words: TypeAlias = frozenset[str]
OptionRule: TypeAlias = NumberLimits | Literal["switch"] | Words | tuple[NumberLimits, ...]
"""A number, a bool, one of several words, or a tuple of numbers."""


@dataclass(frozen=True, slots=True)
class TorchOptimizerRule:
    """The options that a class of `torch.optim` takes, and its default learning rate."""

    lr: float
    options: Mapping[str, OptionRule]
    has_weight_decay: bool = True
    matrices_only: bool = False


_ANY = NumberLimits()
_FROM_0 = NumberLimits(least=0)
_SHARE = NumberLimits(least=0, below=1)
_BETAS = (_SHARE, _SHARE)
_LR_EPS: Mapping[str, OptionRule] = {"lr": _FROM_0, "eps": _FROM_0}

TORCH_OPTIMIZERS: Mapping[str, TorchOptimizerRule] = {
    "ASGD": TorchOptimizerRule(
        1e-2, {"lr": _FROM_0, "lambd": _FROM_0, "alpha": _FROM_0, "t0": _ANY}
    ),
    "Adadelta": TorchOptimizerRule(1.0, {**_LR_EPS, "rho": NumberLimits(least=0, most=1)}),
    "Adafactor": TorchOptimizerRule(
        1e-2,
        {
            "lr": _FROM_0,
            "beta2_decay": NumberLimits(most=0),
            "eps": (NumberLimits(least=0, or_none=True), _FROM_0),
            "d": NumberLimits(least=1),
        },
    ),
    "Adagrad": TorchOptimizerRule(
        1e-2, {**_LR_EPS, "lr_decay": _FROM_0, "initial_accumulator_value": _FROM_0}
    ),
    "Adam": TorchOptimizerRule(
        1e-3,
        {**_LR_EPS, "betas": _BETAS, "amsgrad": "switch", "decoupled_weight_decay": "switch"},
    ),
    "AdamW": TorchOptimizerRule(1e-3, {**_LR_EPS, "betas": _BETAS, "amsgrad": "switch"}),
    "Adamax": TorchOptimizerRule(2e-3, {**_LR_EPS, "betas": _BETAS}),
    "Muon": TorchOptimizerRule(
        1e-3,
        {
            "lr": _FROM_0,
            "momentum": _FROM_0,
            "nesterov": "switch",
            "ns_coefficients": (_ANY, _ANY, _ANY),
            "eps": _ANY,
            "ns_steps": NumberLimits(below=100, whole=True),
            "adjust_lr_fn": frozenset({"original", "match_rms_adamw", "spectral_unclamped"}),
        },
        matrices_only=True,
    ),
    "NAdam": TorchOptimizerRule(
        2e-3,
        {
            **_LR_EPS,
            "betas": _BETAS,
            "momentum_decay": _FROM_0,
            "decoupled_weight_decay": "switch",
        },
    ),
    "RAdam": TorchOptimizerRule(
        1e-3, {**_LR_EPS, "betas": _BETAS, "decoupled_weight_decay": "switch"}
    ),
    "RMSprop": TorchOptimizerRule(
        1e-2, {**_LR_EPS, "alpha": _FROM_0, "momentum": _FROM_0, "centered": "switch"}
    ),
    "Rprop": TorchOptimizerRule(
        1e-2,
        {
            "lr": _FROM_0,
            "etas": (NumberLimits(above=0, below=1), NumberLimits(above=1)),
            "step_sizes": (_ANY, _ANY),
        },
        has_weight_decay=False,
    ),
    "SGD": TorchOptimizerRule(
        1e-3, {"lr": _FROM_0, "momentum": _FROM_0, "dampening": _ANY, "nesterov": "switch"}
    ),
}
_DECOUPLED = frozenset({"Adafactor", "AdamW", "Muon"})
_OTHERS = {
    "LBFGS": "`lbfgs: {}` is that with a line search",
    "SparseAdam": "it takes sparse gradients, and those of models here are dense",
}
"""Optimisers that cannot take a step from one dense gradient."""


def is_decay_decoupled(optimizer: TorchOptimizer) -> bool:
    """True if weight decay shrinks the values directly instead of changing the gradient."""
    switch = optimizer.options.get("decoupled_weight_decay")
    return optimizer.name.value in _DECOUPLED or (switch is not None and switch.value is True)


def check_torch_optimizer(
    optimizer: TorchOptimizer,
    weight_decay: float,
    trained: Iterable[Parameter],
    findings: Findings,
) -> float:
    """The learning rate of an optimiser of torch; unknown and wrong options are reported to
    `findings`.
    """
    name = optimizer.name
    rule = TORCH_OPTIMIZERS.get(name.value)
    if rule is None:
        why = _OTHERS.get(name.value)
        report = errors.unknown_torch_optimizer(name.value, name.span, TORCH_OPTIMIZERS, why)
        findings.report(report)
        # any rate: the stage is refused anyway
        return 1.0
    for option, found in optimizer.options.items():
        accepted = rule.options.get(option)
        if accepted is None:
            span = found.key or name.span
            report = errors.unknown_torch_option(option, name.value, span, rule.options)
            findings.report(report)
        elif not fits(found.value, accepted):
            reason = f"`{option}` is {_described(accepted)}"
            findings.report(errors.refused_by_torch(name.value, reason, found.span))
    # it would be left out without a word: its class has no such argument
    if weight_decay and not rule.has_weight_decay:
        findings.report(errors.no_weight_decay(name.value, name.span))
    for parameter in trained:
        # raised before the stage, where torch says it once the optimiser is made
        if rule.matrices_only and len(parameter.axes) != 2:
            reason = f"it trains matrices, and `{parameter.name}` is none"
            findings.report(errors.refused_by_torch(name.value, reason, name.span))
            # one matrix that is none is enough to see what is meant
            break
    lr = optimizer.options.get("lr")
    return float(lr.value) if lr is not None and isinstance(lr.value, int | float) else rule.lr


def fits(value: OptionValue | None, rule: OptionRule) -> bool:
    """True if torch accepts the value for an option."""
    match rule:
        case "switch":
            return isinstance(value, bool)
        case NumberLimits():
            if value is None:
                return rule.or_none
            kind = int if rule.whole else int | float
            # bool is an int of Python, but `lr: true` is a slip
            if isinstance(value, bool) or not isinstance(value, kind):
                return False
            return rule.least <= value <= rule.most and rule.above < value < rule.below
        case frozenset():
            return value in rule
        case _:
            if not isinstance(value, tuple) or len(value) != len(rule):
                return False
            return all(fits(item, each) for item, each in zip(value, rule, strict=True))


def _described(rule: OptionRule) -> str:
    match rule:
        case "switch":
            return "true or false"
        case NumberLimits():
            limits = [
                f"at least {rule.least:g}" if math.isfinite(rule.least) else "",
                f"at most {rule.most:g}" if math.isfinite(rule.most) else "",
                f"above {rule.above:g}" if math.isfinite(rule.above) else "",
                f"below {rule.below:g}" if math.isfinite(rule.below) else "",
            ]
            noun = "an integer" if rule.whole else "a number"
            return f"{noun} {' and '.join(filter(None, limits))}".rstrip()
        case frozenset():
            return " or ".join(f"`{word}`" for word in sorted(rule))
        case _:
            return f"a list: {', '.join(map(_described, rule))}"
