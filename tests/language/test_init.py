"""R7: `init` is evaluated once, at t0, not over the simulation; values are in `cases/`."""

import pytest

from tests.language.compiled import codes


@pytest.mark.parametrize("init", ["z", "next(z)", "flow(z)"])
def test_init_never_reads_the_simulation(init: str) -> None:
    text = f"inputs: {{x: m}}\nstates: {{z: {{next: z + x, init: {init}}}}}\noutputs: {{y: z}}"
    assert len(codes(text)) == 1
