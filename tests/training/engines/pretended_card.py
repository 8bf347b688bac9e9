"""Pretends a graphics card: torch computes on the CPU, but tensors of two devices do not mix.

What a device changes of a program is where its tensors must be. This keeps the device of every
storage, gives tensors a `device` that says so, and raises where real CUDA would: an operation on
tensors of two devices, or numpy of a tensor on the card. Single numbers may come from the CPU, and
`copy_` goes between devices, as in torch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

_torch: Any = torch._C
_CPU = torch.device("cpu")
_READ_DEVICE: Any = Tensor.device.__get__  # pyright: ignore
_MIXING = (Tensor.copy_, Tensor.to)
"""Whose operands may be on different devices."""


class WrongDeviceError(AssertionError):
    """What CUDA would refuse."""


class PretendedCard(TorchFunctionMode):
    """Within it there is the device `cuda`, as far as tensors know."""

    def __init__(self) -> None:
        super().__init__()
        self._devices: dict[int, torch.device] = {}
        self._kept: list[Tensor] = []
        self.on_card = 0
        """Operations whose result lies on the card."""

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Sequence[type],
        args: tuple[Any, ...] = (),
        kwargs: Mapping[str, Any] | None = None,
    ) -> Any:
        given = dict(kwargs or {})
        if func == _READ_DEVICE:
            return self._device(args[0])
        tensors = list(_tensors((args, given)))
        if func is Tensor.numpy and self._device(args[0]) != _CPU:
            raise WrongDeviceError("numpy of a tensor on the card")
        asked = _asked(func, args, given)
        if func not in _MIXING:
            self._refuse_mixing(func, tensors)
        if asked is not None:
            args, given = _on_cpu(args), _on_cpu(given)
        result = func(*args, **given)
        if asked is not None and func in (Tensor.to, Tensor.cpu):
            result = result.clone()  # a move, not the same tensor
        place = self._device(args[0]) if func is Tensor.copy_ else asked or self._common(tensors)
        for tensor in _tensors(result):
            self._keep(tensor, place)
        return result

    def _refuse_mixing(self, func: Callable[..., Any], tensors: list[Tensor]) -> None:
        found = {str(self._device(tensor)) for tensor in tensors if tensor.dim()}
        if len(found) > 1:
            message = f"{getattr(func, '__name__', func)} of tensors on {' and '.join(found)}"
            raise WrongDeviceError(message)

    def _common(self, tensors: list[Tensor]) -> torch.device:
        found = [self._device(tensor) for tensor in tensors]
        return next((device for device in found if device != _CPU), _CPU)

    def _device(self, tensor: Tensor) -> torch.device:
        with _torch.DisableTorchFunction():
            return self._devices.get(_storage(tensor), _CPU)

    def _keep(self, tensor: Tensor, device: torch.device) -> None:
        with _torch.DisableTorchFunction():
            self._devices[_storage(tensor)] = device
            self._kept.append(tensor)  # so that no other tensor takes its memory
        self.on_card += device != _CPU


def _storage(tensor: Tensor) -> int:
    while _torch._functorch.is_functorch_wrapped_tensor(
        tensor
    ):  # as forward mode hands them around
        tensor = _torch._functorch.get_unwrapped(tensor)
    return tensor.untyped_storage().data_ptr()


def _tensors(value: Any) -> Iterator[Tensor]:
    match value:
        case Tensor():
            yield value
        case dict():
            for part in value.values():
                yield from _tensors(part)
        case list() | tuple():
            for part in value:
                yield from _tensors(part)
        case _:
            pass


def _asked(
    func: Callable[..., Any], args: tuple[Any, ...], given: Mapping[str, Any]
) -> torch.device | None:
    """The device that a call names for its result."""
    if func is _torch._nn._parse_to:  # reads the arguments of a module's `to`
        return None
    if func is Tensor.cpu:
        return _CPU
    places = [given.get("device"), *(arg for arg in args if isinstance(arg, torch.device))]
    if func is Tensor.to:
        places += [arg for arg in args if isinstance(arg, str)]
    return next((torch.device(place) for place in places if place is not None), None)


def _on_cpu(arguments: Any) -> Any:
    """The arguments of a call with the CPU in the place of any other device."""
    if isinstance(arguments, dict):
        return {key: _CPU if key == "device" else value for key, value in arguments.items()}
    return tuple(_CPU if isinstance(arg, torch.device) else arg for arg in arguments)
