"""Computes physical parameters from raw variables in torch, by `raw_parameters`' formulas."""

from __future__ import annotations

import torch
from torch import Tensor

from compiler.ir.program import Parameter


def physical_value(parameter: Parameter, raw: Tensor) -> Tensor:
    """The physical value that a raw variable stands for; differentiable, same shape."""
    match parameter.minimum, parameter.maximum:
        case None, None:
            return raw * parameter.scale
        case float(low), None:
            return low + parameter.scale * _softplus(raw)
        case None, float(high):
            return high - parameter.scale * _softplus(-raw)
        case float(low), float(high):
            # a sigmoid for each side: the slope of |raw| at 0 would be that of neither
            span = high - low
            above, below = high - span * torch.sigmoid(-raw), low + span * torch.sigmoid(raw)
            return torch.where(raw > 0, above, below)
        case _:
            raise AssertionError("bounds are floats or None")


def _softplus(raw: Tensor) -> Tensor:
    # torch's softplus is x itself above 20: its slope there would not be that of the kernels
    return torch.logaddexp(raw, torch.zeros_like(raw))
