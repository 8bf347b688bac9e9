"""Reports properties of the system that the data show, independent of the model."""

from __future__ import annotations

from collections.abc import Iterator

from msnn.features.data_check.dynamics.excitation import Excitation
from msnn.features.data_check.dynamics.impulse_response import FALSE_ALARMS
from msnn.features.data_check.errors import dynamics as errors
from msnn.features.data_check.errors.checks import too_few_rows
from msnn.features.data_check.found import CheckedSystem, CheckedTarget
from spec_schema.diagnostics.diagnostic import Diagnostic

_FEWEST_ROWS = 30


def dynamics_findings(system: CheckedSystem, *, resampled: bool) -> Iterator[Diagnostic]:
    """Reports inputs with weak excitation, and targets without a visible response."""
    for dependence in system.about.dependences:
        terms = [
            f"{factor:.4g} {system.inputs[other].name}" for other, factor in dependence.factors
        ]
        yield errors.dependent_inputs(
            input=system.inputs[dependence.number].name,
            formula=" + ".join(terms).replace("+ -", "- "),
            share=dependence.share,
        )
    for channel, found in zip(system.inputs, system.about.excitation, strict=True):
        # an input without excitation stands still, which is said of the column
        if found is not None and found.weak:
            yield errors.weak_excitation(
                input=channel.name,
                order=found.order,
                needed=found.tested,
                highest=highest_frequency(found, system.step),
            )
    for target in system.targets:
        yield from _target(system, target, resampled=resampled)


def highest_frequency(found: Excitation, step: float) -> float:
    """Upper end in Hz of the band that contains 99 % of the power."""
    return found.highest / step


def _target(
    system: CheckedSystem, target: CheckedTarget, *, resampled: bool
) -> Iterator[Diagnostic]:
    found, name = target.found, target.channel.name
    # of an input that stands still nothing can be answered
    moving = [i for i, excites in enumerate(system.about.excitation) if excites is not None]
    if not moving or not target.moves:
        return
    if found.responses is None:
        needed = _needed(len(system.inputs))
        # too little for a long model, from which everything else follows
        yield too_few_rows(
            rows=found.rows,
            longest=found.longest,
            needed=needed,
            of=name,
            resampled=resampled,
        )
        return
    for number, share in enumerate(found.feedback):
        if share is not None:
            yield errors.closed_loop_data(
                input=system.inputs[number].name, signal=name, share=share
            )
    # an input that excites little may have an answer that nobody sees
    told = [i for i in moving if _told(system, i)]
    unseen = all(found.delays[i] is None and not found.responses.answers(i) for i in told)
    if told and unseen:
        yield errors.no_response(
            signal=name,
            inputs=[system.inputs[i].name for i in told],
            lags=found.responses.lags,
            # of the lags one by one, and of all together
            chance=2 * FALSE_ALARMS,
        )


def _told(system: CheckedSystem, number: int) -> bool:
    """True if the excitation suffices to conclude that there is no response."""
    excites = system.about.excitation[number]
    return excites is not None and not excites.weak


def _needed(inputs: int) -> int:
    return max(_FEWEST_ROWS, _FEWEST_ROWS * inputs)
