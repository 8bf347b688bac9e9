"""Builds CasADi functions of a program in step form: the step and the initial states."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import casadi

from backends.casadi_function.lowering import Expression, Symbols, exact_arithmetic, lower_nodes
from backends.casadi_function.options import Form
from backends.ports.step_interface import Port, PortNames, port_names, step_interface
from compiler.ir.program import Parameter, Program
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.ir.types import Axis
from compiler.passes.expand_functions import expand_functions
from compiler.passes.guard_derivatives import guard_infinite_slopes, guard_untaken

NATIVE = frozenset(name for name, row in SCALAR_FUNCTIONS.items() if row.casadi)
"""Scalar functions that CasADi has; others are lowered by their definition."""

# reserved words of CasADi for names of functions and ports
_KEYWORDS = ("null", "jac", "hess")

# an optimal control problem with many steps calls this function, so that its generated code stays
# small, also if the problem is expanded to scalars
_OPTIONS = {"never_inline": True}


def build_function(program: Program, name: str = "step", *, form: Form = "mx") -> casadi.Function:
    """The step as a CasADi function called `name`. Its arguments are inputs, states and parameters,
    in this order; its results are outputs, then next states. `casadi_names` gives the names of
    ports.

    A port is a column of its elements in C order (window last): 6 joints × 30 samples are 180 rows,
    the samples of the first joint first. Values are physical, in the units of the spec. The form
    `mx` keeps matrix expressions; `sx` has scalar expressions, for small models only. Raises
    ValueError for a program in window form.
    """
    program = _prepared(program)
    interface = step_interface(program)
    names = casadi_names(program)
    inputs = [
        (port, _symbol(names.inputs[port.signal.name], port.type.axes)) for port in interface.inputs
    ]
    states = {state.name: _symbol(names.states[state.name], state.axes) for state in program.states}
    parameters = _parameters(interface.parameters, names)
    # simplification happens when expressions are created
    with exact_arithmetic():
        symbols = Symbols(_by_signal(inputs), states, parameters)
        values = lower_nodes(program.step, interface.step_nodes, symbols)
    arguments = [symbol for _, symbol in inputs] + [*states.values(), *parameters.values()]
    results = [values[output.node] for output in interface.outputs]
    results += [values[state.next] for state in interface.states]
    result_names = [*names.outputs.values(), *names.next_states.values()]
    if form == "mx":
        return _function(name, arguments, results, result_names, _OPTIONS)
    with exact_arithmetic():
        # without `never_inline`, so that it is inlined in scalar expressions
        return _function(name, arguments, results, result_names, {}).expand(name)


def build_initial_state(
    program: Program, name: str = "initial_state", *, form: Form = "mx"
) -> casadi.Function:
    """The states before the first step as a CasADi function called `name`. Its arguments are
    windows of recorded samples around the first step, then parameters; `casadi_names` gives their
    names.

    A window has the samples t0+first … t0+last of one signal; the metadata describes it. A port is
    a column of its elements in C order. The form `mx` keeps matrix expressions; `sx` has scalar
    expressions, for small models only. Raises ValueError for a program in window form.
    """
    program = _prepared(program)
    interface = step_interface(program)
    names = casadi_names(program)
    windows = [
        (port, _symbol(names.start_windows[port.signal.name], port.type.axes))
        for port in interface.start_windows
    ]
    parameters = _parameters(interface.start_parameters, names)
    with exact_arithmetic():
        symbols = Symbols(_by_signal(windows), {}, parameters)
        values = lower_nodes(program.start, interface.start_nodes, symbols)
    arguments = [symbol for _, symbol in windows] + [*parameters.values()]
    results = [values[state.start] for state in interface.states]
    result_names = list(names.states.values())
    if form == "mx":
        return _function(name, arguments, results, result_names, _OPTIONS)
    with exact_arithmetic():
        return _function(name, arguments, results, result_names, {}).expand(name)


def casadi_names(program: Program) -> PortNames:
    """The names of the ports of both functions, by name in the spec. Raises ValueError for a
    program in window form.
    """
    return port_names(step_interface(program), _KEYWORDS)


def _prepared(program: Program) -> Program:
    # CasADi evaluates 0 · ∞ as NaN in derivatives without the guards
    return guard_infinite_slopes(guard_untaken(expand_functions(program, NATIVE)))


def _symbol(name: str, axes: Iterable[Axis]) -> Expression:
    size = 1
    for axis in axes:
        size *= axis.size
    return casadi.MX.sym(name, size)


def _parameters(parameters: Iterable[Parameter], names: PortNames) -> dict[str, Expression]:
    return {p.name: _symbol(names.parameters[p.name], p.axes) for p in parameters}


def _by_signal(ports: list[tuple[Port, Expression]]) -> dict[str, tuple[Port, Expression]]:
    return {port.signal.name: (port, symbol) for port, symbol in ports}


def _function(
    name: str,
    arguments: list[Expression],
    results: list[Expression],
    result_names: list[str],
    options: Mapping[str, bool],
) -> casadi.Function:
    argument_names = [argument.name() for argument in arguments]
    return casadi.Function(name, arguments, results, argument_names, result_names, dict(options))
