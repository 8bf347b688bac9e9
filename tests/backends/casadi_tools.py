"""Stands in for do-mpc and acados: takes what a model is told, as their model classes do."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import casadi
import pytest


class Told:
    """`do_mpc.model.Model`, as far as the README calls it."""

    def __init__(self, model_type: str, symvar_type: str) -> None:
        self.types = (model_type, symvar_type)
        self.variables: dict[str, dict[str, casadi.MX]] = {"_x": {}, "_u": {}, "_tvp": {}}
        self.following: dict[str, casadi.MX] = {}
        self.is_set_up = False

    def set_variable(self, kind: str, name: str, shape: tuple[int, int]) -> casadi.MX:
        return self.variables[kind].setdefault(name, casadi.MX.sym(name, *shape))

    def set_rhs(self, name: str, expression: casadi.MX) -> None:
        assert self.variables["_x"][name].shape == expression.shape
        self.following[name] = expression

    def setup(self) -> None:
        assert self.following.keys() == self.variables["_x"].keys()
        self.is_set_up = True


def install(patched: pytest.MonkeyPatch) -> None:
    """Makes both importable."""
    modules: dict[str, dict[str, Any]] = {
        "do_mpc": {"model": SimpleNamespace(Model=Told)},
        "acados_template": {"AcadosModel": SimpleNamespace},
    }
    for name, members in modules.items():
        module = ModuleType(name)
        module.__dict__.update(members)
        patched.setitem(sys.modules, name, module)
