"""Times the gradient of a rollout's loss in the friction of an arm: msnn's kernel beside ADAM.

The second stage of examples/z1_friction: 120 rollouts of 50 samples, two linear-implicit steps
each, the friction's 73 numbers learned. ADAM's PyTorch backend gives mass matrix and bias force of
the whole batch, torch the rest. Both see the same random log; loss and gradient are compared, and
runs are interleaved, each on one thread.

    python benchmarks/robots/gradient.py

Needs `pip install adam-robotics`, which the suite does not.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from adam import Representations
from adam.pytorch import KinDynComputationsBatch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import softplus

sys.path.insert(0, str(Path(__file__).parents[2]))

from backends.native.kernel import Kernel
from backends.native.variables import by_parameter, flat
from msnn.model.load import load_model
from msnn.training.plans.stage_plan import plan_stages
from spec_schema.diagnostics.diagnostic import Findings

Array = NDArray[np.float64]
EXAMPLE = Path(__file__).parents[2] / "examples" / "z1_friction"
BATCH, HORIZON, SUBSTEPS, SAMPLE_TIME, ARMATURE = 120, 50, 2, 0.01, 0.02
WEIGHTS = {"position": 100.0, "speed": 1.0}
ROUNDS, CALLS = 5, 10


def drawn() -> dict[str, Array]:
    """Random data: the rollouts one after the other, with random states and slowly changing
    torques.
    """
    rng = np.random.default_rng(3)
    rows = BATCH * (HORIZON + 1)
    t = np.arange(rows)[:, None] * SAMPLE_TIME
    tau = 5 * np.sin(2 * np.pi * rng.uniform(0.2, 1.0, 6) * t + rng.uniform(0, 6, 6))
    return {"q": rng.uniform(-1, 1, (rows, 6)), "dq": rng.uniform(-1, 1, (rows, 6)), "tau": tau}


def starting() -> dict[str, Array]:
    """The initial parameters: a friction that grows with speed, so that no rollout is unstable."""
    rng = np.random.default_rng(4)
    means = {"C_v": 0.8, "C_c": 0.2, "C_s": 0.3, "C_w": -0.3}
    found: dict[str, Array] = {
        name: np.array([1.0, 0, 0]) * mean + rng.normal(0, 0.05, (6, 3))
        for name, mean in means.items()
    }
    return found | {"w_0": np.array(0.06)}


class OfMsnn:
    """Loss and gradient by the training kernel of the spec."""

    def __init__(self, log: dict[str, Array], weights: dict[str, Array], dtype: str) -> None:
        model = load_model(EXAMPLE / "z1_friction.msnn.yaml")
        plan = plan_stages(model.program, model.spec.train, Findings())[-1]
        self._program = plan.rollout.program
        self._kernel = Kernel(self._program, "float32" if dtype == "float32" else "float64")
        self._data = self._kernel.data(log)
        starts = np.arange(BATCH, dtype=np.int64) * (HORIZON + 1)
        self._groups = self._kernel.groups(starts, HORIZON)
        self._physical = flat(self._program, weights)
        self._shares = [WEIGHTS.get(name, 0.0) for name in self._kernel.source.losses]

    def __call__(self) -> tuple[float, dict[str, Array]]:
        found = self._kernel.losses(self._data, self._groups, self._physical, self._shares)
        loss = float(np.dot(found.sums / found.counts, self._shares))
        return loss, by_parameter(self._program, found.gradient)


class OfAdam:
    """Loss and gradient by ADAM's batched mass matrix and bias force, and autograd."""

    def __init__(
        self, log: dict[str, Array], weights: dict[str, Array], dtype: torch.dtype
    ) -> None:
        names = [f"joint{number}" for number in range(1, 7)]
        gravity = torch.tensor([0, 0, -9.81, 0, 0, 0], dtype=dtype)
        urdf, device = str(EXAMPLE / "z1.urdf"), torch.device("cpu")
        self._arm = KinDynComputationsBatch(urdf, names, device, dtype, gravity=gravity)
        self._arm.set_frame_velocity_representation(Representations.BODY_FIXED_REPRESENTATION)
        self._base = torch.eye(4, dtype=dtype).expand(BATCH, 4, 4)
        self._still = torch.zeros(BATCH, 6, dtype=dtype)
        self._eye = torch.eye(6, dtype=dtype)
        self._log = {
            name: torch.tensor(values.reshape(BATCH, HORIZON + 1, 6), dtype=dtype)
            for name, values in log.items()
        }
        self._weights = {n: torch.tensor(v, dtype=dtype) for n, v in weights.items()}

    def __call__(self) -> tuple[float, dict[str, Array]]:
        theta = {n: v.clone().requires_grad_() for n, v in self._weights.items()}
        q, dq = self._log["q"][:, 0], self._log["dq"][:, 0]
        h, loss = SAMPLE_TIME / SUBSTEPS, torch.zeros(())
        for k in range(HORIZON):
            tau = self._log["tau"][:, k]
            for _ in range(SUBSTEPS):
                mass = self._arm.mass_matrix(self._base, q)[:, 6:, 6:] + ARMATURE * self._eye
                bias = self._arm.bias_force(self._base, q, self._still, dq)[:, 6:]
                torque, slope = _friction(theta, q, dq)
                matrix = mass + h * torch.diag_embed(slope)
                dq = dq + torch.linalg.solve(matrix, h * (tau - torque - bias))
                q = q + h * dq
            position = torch.mean((q - self._log["q"][:, k + 1]) ** 2)
            speed = torch.mean((dq - self._log["dq"][:, k + 1]) ** 2)
            loss = loss + (WEIGHTS["position"] * position + WEIGHTS["speed"] * speed) / HORIZON
        loss.backward()
        slopes = {n: v.grad for n, v in theta.items()}
        return loss.item(), {n: s.double().numpy() for n, s in slopes.items() if s is not None}


def _friction(theta: dict[str, Tensor], q: Tensor, w: Tensor) -> tuple[Tensor, Tensor]:
    """The friction torque, and its derivative with respect to speed."""
    basis = torch.stack([torch.ones_like(q), torch.sin(q), torch.cos(q)], dim=-1)
    kv, kc, ks, ws = (softplus(torch.sum(theta[f"C_{n}"] * basis, -1)) for n in "vcsw")
    sign, fall = torch.tanh(w / theta["w_0"]), torch.exp(-((w / ws) ** 2))
    level = kc + (ks - kc) * fall
    steep = (1 - sign**2) / theta["w_0"] * level - 2 * sign * (ks - kc) * fall * w / ws**2
    return kv * w + sign * level, kv + steep


def seconds(run: Callable[[], object], calls: int) -> float:
    """Processor time of one call."""
    begun = time.process_time()
    for _ in range(calls):
        run()
    return (time.process_time() - begun) / calls


def main() -> None:
    torch.set_num_threads(1)
    log, weights = drawn(), starting()
    for dtype, tolerance in (("float64", 1e-9), ("float32", 1e-3)):
        ours = OfMsnn(log, weights, dtype)
        theirs = OfAdam(log, weights, getattr(torch, dtype))
        (loss, slopes), (expected, right) = ours(), theirs()
        norm = np.sqrt(sum(np.sum(s**2) for s in right.values()))
        off = np.sqrt(sum(np.sum((slopes[n] - right[n]) ** 2) for n in right)) / norm
        print(f"{dtype}: loss {loss:.10g}, ADAM {expected:.10g}, gradients differ by {off:.1e}")
        assert abs(loss - expected) <= tolerance * expected
        assert off <= 10 * tolerance
        times = [(seconds(ours, CALLS), seconds(theirs, 1)) for _ in range(ROUNDS)]
        of_ours, of_theirs = (min(each) for each in zip(*times, strict=True))
        print(
            f"{dtype}: msnn {1000 * of_ours:.1f} ms, ADAM {1000 * of_theirs:.0f} ms of processor "
            f"time, {of_theirs / of_ours:.0f} times as long"
        )


if __name__ == "__main__":
    main()
