"""The sections `mpc` and `estimator`, as the compiler and `msnn show` call them."""

from __future__ import annotations

from collections.abc import Iterable

from compiler.elaboration.section import CompiledSection, CompileOther, Section
from compiler.ir.program import Program
from compiler.linking.link import Linked
from msnn.features.control.elaborate.control_problem import asked_control, control_problem
from msnn.features.control.elaborate.estimation_problem import estimation_problem
from msnn.features.control.keys import Estimator, OptimalControl
from msnn.features.control.problem.optimal_control import ControlProblem
from msnn.features.control.problem.state_estimation import EstimationProblem
from spec_schema.sections.references import names_in


def _names_used(entry: OptimalControl) -> Iterable[str]:
    # the keys of `bounds` are names too
    return (*names_in(entry), *entry.bounds)


def _compile_control(
    entry: OptimalControl, linked: Linked, program: Program, compile_other: CompileOther
) -> CompiledSection[ControlProblem]:
    del program
    # costs and limits become outputs of a second spec, so that exports of the model alone have none
    # of them
    asked = asked_control(linked, entry)
    whole = compile_other(asked.linked)
    return CompiledSection(*control_problem(asked, whole.program, whole.findings))


def _compile_estimator(
    entry: Estimator, linked: Linked, program: Program, compile_other: CompileOther
) -> CompiledSection[EstimationProblem]:
    del compile_other
    return CompiledSection(estimation_problem(linked.spec, entry, program))


def _control_text(problem: ControlProblem) -> str:
    from msnn.features.control.show import control_text  # compiling starts without it

    return control_text(problem)


def _estimation_text(problem: EstimationProblem) -> str:
    from msnn.features.control.show import estimation_text

    return estimation_text(problem)


MPC = Section(compile=_compile_control, text=_control_text, names_used=_names_used)
ESTIMATOR = Section(compile=_compile_estimator, text=_estimation_text)
