"""Compiles the C of a predictive controller for this machine, kept in the cache of kernels."""

from __future__ import annotations

import json

from backends.native.compile_kernel import compiled_kernel
from backends.native.exported.one_text import one_text
from msnn.features.control.backend.library import ControllerLibrary
from msnn.features.control.backend.write_controller import controller_texts
from msnn.features.control.problem.optimal_control.problem import ControlProblem

_PREFIX = "plant"


def native_controller(problem: ControlProblem) -> ControllerLibrary:
    """A controller of a problem without parameters, in float64.

    Raises CompilerMissingError and KernelBuildError.
    """
    texts = controller_texts(problem, _PREFIX, "float64")
    about = json.loads(texts[f"{_PREFIX}_mpc.json"])
    return ControllerLibrary(about, compiled_kernel(one_text(texts)).library)
