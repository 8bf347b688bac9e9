"""Runs saved models in nnodely with doubles in place of its single precision.

    python double_precision.py FOLDER NAME …

Reads FOLDER/NAME.json of a worker and writes FOLDER/double/NAME.json: the same model, weights and
log, and what the peer's own code computes of them where each of its tensors is a double. Models of
its own tests are `suite_TEST_NUMBER`.
"""

from __future__ import annotations

import json
import logging
import sys
import tempfile
from pathlib import Path

import numpy as np
import torch
from nnodely import Modely, clearNames
from worker import predicted

for module in [module for name, module in sys.modules.items() if name.startswith("nnodely")]:
    # each of its modules has names of its own for the types
    for name, wide in (("TORCH_DTYPE", torch.float64), ("NP_DTYPE", np.float64)):
        if hasattr(module, name):
            setattr(module, name, wide)
torch.set_default_dtype(torch.float64)


def main() -> None:
    folder = Path(sys.argv[1])
    (folder / "double").mkdir(exist_ok=True)
    for name in sys.argv[2:]:
        recorded = json.loads((folder / f"{name}.json").read_text())
        is_of_suite = name.startswith("suite_")
        drawn_by = name.rpartition("_")[0] if is_of_suite else name
        try:
            kept = in_double(recorded, drawn_by, begins_loops=not is_of_suite)
        except Exception as fault:  # noqa: BLE001  (nnodely fails in many ways)
            kept = f"{type(fault).__name__}: {fault}"
        if isinstance(kept, str):
            print(f"{name}: not in doubles: {kept}")
        else:
            (folder / "double" / f"{name}.json").write_text(json.dumps(kept))


def in_double(
    recorded: dict[str, object], name: str, *, begins_loops: bool
) -> dict[str, object] | str:
    """The recorded model with outputs in double precision, or a text with the reason why there are
    none.

    `name` determines how its data were drawn.
    """
    clearNames()
    m = Modely(visualizer=None)
    with tempfile.TemporaryDirectory() as place:
        (Path(place) / f"{name}.json").write_text(str(recorded["model"]))
        m.loadModel(name, place)
        m.neuralizeModel()
    kept = predicted(m, name, begins_loops=begins_loops)
    if isinstance(kept, str):
        return kept
    assert kept["log"] == recorded["log"], "another log was drawn"
    return recorded | {"outputs": kept["outputs"]}


if __name__ == "__main__":
    logging.disable(logging.CRITICAL)
    main()
