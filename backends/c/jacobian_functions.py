"""The functions that an export with a Jacobian has beside the step."""

from __future__ import annotations

from backends.c.c_language import Function
from backends.c.function_writer import Model
from backends.c.jacobian_interface import JacobianInterface
from backends.c.linearize_function import linearize_function
from backends.c.vector_functions import vector_functions


def jacobian_functions(model: Model, interface: JacobianInterface) -> dict[str, Function]:
    """By name: `linearize`, and what copies structs into vectors and back."""
    vectors = vector_functions(model.interface, interface)
    return {"linearize": linearize_function(model, interface), **vectors}
