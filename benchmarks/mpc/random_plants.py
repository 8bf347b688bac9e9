"""Draws random plants with predictive controllers, as specs.

They differ in states, nonlinearities, limits and memory. Half of the plants read older samples of
their controls, single ones or a whole window. In a third of them controls are one vector of two; in
a third some controls have rate limits. Weights and limits are references, so that each problem has
its own. In half of the plants limits are formulas of these; one of them is a root, which is NaN
where `s` is negative. In half of the others they differ from sample to sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WEIGHTS = ("q", "w", "e")
_BENDS = ("0.3 * sin({})", "0.2 * {}**2", "0.5 * tanh({})", "0.1 * abs({})", "0")


@dataclass(frozen=True, slots=True)
class Plant:
    """A random spec, and the names of its references."""

    text: str
    known: tuple[str, ...]
    """Limits are `lo0`, `hi0`, `lo1`, `hi1`: of a vector the elements of `lo` and `hi`."""
    is_vector: bool
    is_computed: bool
    """Whether limits are `computed_limits` of these."""


def computed_limits(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    r: NDArray[np.float64],
    s: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The limits of a control, computed by the formulas that the spec has."""
    return low - 0.3 * np.abs(r), high + np.sqrt(s)


def drawn_plant(random: np.random.Generator, has_blocks: bool) -> Plant:
    """A plant with a controller."""
    is_vector = bool(random.uniform() < 1 / 3)
    nx, nu = int(random.integers(1, 4)), 2 if is_vector else int(random.integers(1, 3))
    remembers = bool(random.uniform() < 0.5)
    parameters: list[str] = []
    layers: list[str] = []

    def of_controls(sample: str) -> str:
        """A sum of all controls, each with a drawn factor."""
        factors = [round(float(random.normal()), 3) for _ in range(nu)]
        if not is_vector:
            return " + ".join(f"{factors[j]} * u{j}{sample}" for j in range(nu))
        parameters.append(f"b{len(parameters)}: {{dims: j, init: {factors}}}")
        return f"sum(b{len(parameters) - 1} * u{sample})"

    states: list[str] = []
    for i in range(nx):
        terms = [f"{random.uniform(-0.5, 0.6):.3f} * x{j}" for j in range(nx)]
        terms.append(f"{random.uniform(0.6, 1.1):.3f} * x{i}")
        terms.append(of_controls(""))
        terms.append(str(random.choice(_BENDS)).format(f"x{random.integers(nx)}"))
        if remembers and random.uniform() < 0.7:
            terms.append(of_controls(f"[t-{random.integers(1, 6)}]"))
        if remembers and random.uniform() < 0.5:
            layers.append(f"h{i}: {{fir: {{window: {random.integers(2, 9)}}}}}")
            terms.append(f"sum(h{i}(u))" if is_vector else f"h{i}(u0)")
        states.append(f'  x{i}: {{next: "{" + ".join(terms)}", init: 0}}')
    controls = ["u"] if is_vector else [f"u{j}" for j in range(nu)]
    is_computed = bool(random.uniform() < 0.5)
    low, high = ("lo{} - 0.3 * abs(r)", "hi{} + sqrt(s)") if is_computed else ("lo{}", "hi{}")
    has_rates = bool(random.uniform() < 1 / 3)
    bounds: list[str] = []
    for u in controls:
        keys = [f"min: {low.format(u[1:])}", f"max: {high.format(u[1:])}"]
        if has_rates and random.uniform() < 0.7:
            keys.append(f"rate: {10 ** random.uniform(-1, 1.5):.3f}")
        bounds.append(f"    {u}: {{{', '.join(keys)}}}")
    kind = random.integers(4)
    if kind:
        extra = ", hard: true" if kind == 1 else ""
        bounds.append(f"    x0: {{max: top{extra}}}")
    if kind == 3 and nx > 1:
        bounds.append("    x1: {min: -top}")
    moves = "sum(u**2)" if is_vector else " + ".join(f"u{j}**2" for j in range(nu))
    far = " + ".join(f"x{i}**2" for i in range(1, nx)) or "0"
    stage = f"q * ((x0 - r)**2 + {far}) + w * ({moves})"
    curve = random.choice(["exact", "gauss_newton"])
    limits = [f"{end}{j}" for j in range(nu) for end in ("lo", "hi")]
    known = (*WEIGHTS, "r", "top", *(["s"] if is_computed else []), *limits)
    horizon = int(random.choice([1, 2, 5, 10, 20]))
    held: list[str] = []
    if has_blocks:
        blocks: list[int] = []
        while sum(blocks) < horizon:
            blocks.append(int(random.integers(1, 1 + min(7, horizon - sum(blocks)))))
        held = [f"  blocks: {blocks}"]
    has_preview = has_blocks or bool(random.uniform() < 0.5)
    keys = "preview: true, " if has_preview else ""
    references = [f"{name}: {{}}" for name in (*WEIGHTS, "r", "top")]
    references += [f"s: {{{keys.rstrip(', ')}}}"] if is_computed else []
    references += [
        f"{end}{u[1:]}: {{{keys}{'dims: j' if is_vector else ''}}}"
        for u in controls
        for end in ("lo", "hi")
    ]
    inputs = (f"{u}: {{between: hold{', dims: j' if is_vector else ''}}}" for u in controls)
    text = "\n".join(
        (
            "msnn: 1\nname: drawn\nsample_time: 1 s",
            *(["dims: {j: 2}"] if is_vector else []),
            f"inputs: {{{', '.join(inputs)}}}",
            *([f"parameters: {{{', '.join(parameters)}}}"] if parameters else []),
            *([f"layers: {{{', '.join(layers)}}}"] if layers else []),
            "states:",
            *states,
            "outputs: {y: 1 * x0}",
            "mpc:",
            f"  horizon: {horizon}",
            f"  controls: [{', '.join(controls)}]",
            f"  hessian: {curve}",
            f"  references: {{{', '.join(references)}}}",
            *held,
            f'  cost: {{stage: "{stage}", terminal: "e * (x0 - r)**2"}}',
            "  bounds:",
            *bounds,
        )
    )
    return Plant(text, known, is_vector, is_computed)
