"""Identifies a system with sysidentpy: a polynomial NARX chosen by FROLS, in free-run simulation.

It cannot use known equations. Lags and degree are the best of several on the training recording.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from pathlib import Path

import numpy as np

warnings.simplefilter("ignore")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from sysidentpy.basis_function import Polynomial  # noqa: E402
from sysidentpy.model_structure_selection import FROLS  # noqa: E402
from sysidentpy.parameter_estimation import LeastSquares  # noqa: E402
from systems import beginning, processor_seconds  # noqa: E402

data = np.load(sys.argv[2])


def simulated(model, name):
    y, u = data[f"{name}_y"][:, None], data[f"{name}_u"][:, None]
    found = model.predict(X=u, y=y[: model.max_lag])[:, 0]
    return np.nan_to_num(found, nan=1e3, posinf=1e3, neginf=-1e3)


def fitted():
    best, least = None, np.inf
    for lags in (2, 3):
        for degree in (2, 3):
            model = FROLS(
                order_selection=True, n_info_values=15, ylag=lags, xlag=lags, info_criteria="bic",
                estimator=LeastSquares(), basis_function=Polynomial(degree=degree),
            )  # fmt: skip
            model.fit(X=data["train_u"][:, None], y=data["train_y"][:, None])
            error = np.std(simulated(model, "train") - data["train_y"])
            if best is None or error < least:
                best, least = model, error
    return best


seconds, computed = [], []
for fit in range(2):
    began, before = beginning(fit)
    model = fitted()
    seconds.append(time.perf_counter() - began)
    computed.append(processor_seconds() - before)
error = simulated(model, "train") - data["train_y"]
clean = simulated(model, "test") - data["test_clean"]
print(
    json.dumps(
        {
            "seconds": seconds,
            "computed": computed,
            "loss": float(np.mean(error**2)),
            "test": float(np.std(clean)),
            "parameters": [],
        }
    )
)
