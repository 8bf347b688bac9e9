"""Makes a spec with a fault smaller for as long as it keeps the fault."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import islice

from tests.random_specs.random_spec import RandomSpec
from tests.random_specs.trial import Fault

FaultOf = Callable[[RandomSpec], Fault | None]


def shrunk(spec: RandomSpec, fault: Fault, fault_of: FaultOf, seconds: float) -> RandomSpec:
    """The smallest spec found in this time that has the same fault.

    One change at a time that leaves the fault is kept, until none does: with all that it leaves
    without use, or alone. The next one is looked for where that was found, as those before were of
    no use and will rarely be now. A spec that became wrong is refused with another code, which is
    another fault.
    """
    end = time.monotonic() + seconds
    known = {str(spec.texts())}

    def keeps(less: RandomSpec) -> bool:
        text = str(less.texts())
        if less.size > spec.size or text in known:
            return False
        known.add(text)
        now = fault_of(less)
        return now is not None and (now.stage, now.kind) == (fault.stage, fault.kind)

    place, tried = 0, 0
    while time.monotonic() < end:
        for less in islice(spec.smaller(), place, None):
            place, tried = place + 1, tried + 1
            found = next(filter(keeps, (less.without_unnamed(), less)), None)
            if found is not None:
                # entries that went away stood before it: some places are looked at again
                spec, place, tried = found, max(place - 3, 0), 0
                break
            if time.monotonic() > end:
                return spec
        else:
            # round and round, until a whole round finds nothing
            if tried >= place:
                return spec
            place = 0
    return spec
