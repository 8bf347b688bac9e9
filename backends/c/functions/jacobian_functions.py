"""Writes the functions that an export with a Jacobian has beside the step."""

from __future__ import annotations

from backends.c.functions.function_writer import ControllerCode
from backends.c.functions.linearize import linearize_function
from backends.c.functions.state_vector import vector_functions
from backends.c.interface.jacobian_interface import JacobianInterface
from backends.c_language.tree import Function


def jacobian_functions(model: ControllerCode, interface: JacobianInterface) -> dict[str, Function]:
    """By name: `linearize`, and what copies structs into vectors and back."""
    vectors = vector_functions(model.interface, interface)
    return {"linearize": linearize_function(model, interface), **vectors}
