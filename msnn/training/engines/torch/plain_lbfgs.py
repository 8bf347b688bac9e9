"""Makes L-BFGS of torch start without torch's compiler, which has 900 modules."""

from __future__ import annotations

import inspect
from typing import Any

import torch


class PlainLbfgs(torch.optim.LBFGS):
    """The steps of torch's to the bit, for who compiles nothing in torch.

    torch hides these methods from its compiler, and imports it for that when the first is called:
    1.7 seconds of a processor.
    """

    add_param_group: Any = inspect.unwrap(torch.optim.LBFGS.add_param_group)
    state_dict: Any = inspect.unwrap(torch.optim.LBFGS.state_dict)
    load_state_dict: Any = inspect.unwrap(torch.optim.LBFGS.load_state_dict)
