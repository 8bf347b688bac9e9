"""Makes a spec with a fault smaller for as long as it keeps the fault."""

from __future__ import annotations

import time
from collections.abc import Callable

from tests.random_specs.random_spec import RandomSpec
from tests.random_specs.trial import Fault

FaultOf = Callable[[RandomSpec], Fault | None]


def shrunk(spec: RandomSpec, fault: Fault, fault_of: FaultOf, seconds: float) -> RandomSpec:
    """The smallest spec found in this time that has the same fault.

    One change at a time that leaves the fault is kept, until none does. A spec that became wrong is
    refused with another code, which is another fault.
    """
    end = time.monotonic() + seconds
    known = {spec.size: {str(spec.texts())}}
    found = True
    while found and time.monotonic() < end:
        found = False
        for less in spec.smaller():
            text = str(less.texts())
            if less.size > spec.size or text in known.setdefault(less.size, set()):
                continue
            known[less.size].add(text)
            now = fault_of(less)
            if now is not None and (now.stage, now.kind) == (fault.stage, fault.kind):
                spec, found = less, True
                break
            if time.monotonic() > end:
                break
    return spec
