"""Compiles the C of a predictive controller for this machine, kept in the cache of kernels."""

from __future__ import annotations

import json

from backends.native.compile_kernel import compiled_kernel
from backends.native.exported.one_text import one_text
from backends.predictive_control.library import ControllerLibrary
from backends.predictive_control.write_controller import controller_texts
from compiler.optimal_control.problem import ControlProblem

_PREFIX = "plant"


def native_controller(problem: ControlProblem) -> ControllerLibrary:
    """A controller of a problem without parameters, in float64.

    Raises CompilerMissingError and KernelBuildError.
    """
    texts = controller_texts(problem, _PREFIX, "float64")
    about = json.loads(texts[f"{_PREFIX}_mpc.json"])
    return ControllerLibrary(about, compiled_kernel(one_text(texts)).library)
