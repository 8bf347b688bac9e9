"""Computes physical parameters from raw variables in torch, by the formulas of `raw_parameters`."""

from __future__ import annotations

import torch
from torch import Tensor

from compiler.ir.program import Parameter


def physical_value(parameter: Parameter, raw: Tensor) -> Tensor:
    """The physical value of a raw variable; differentiable, same shape."""
    match parameter.minimum, parameter.maximum:
        case None, None:
            return raw * parameter.scale
        case float(low), None:
            return low + parameter.scale * _softplus(raw)
        case None, float(high):
            return high - parameter.scale * _softplus(-raw)
        case float(low), float(high):
            # one sigmoid per side: |raw| would have the wrong derivative at 0
            span = high - low
            above, below = high - span * torch.sigmoid(-raw), low + span * torch.sigmoid(raw)
            return torch.where(raw > 0, above, below)
        case _:
            raise AssertionError("bounds are floats or None")


def _softplus(raw: Tensor) -> Tensor:
    # torch's softplus is x above 20, with another derivative than the kernels
    return torch.logaddexp(raw, torch.zeros_like(raw))
