"""The total of a stage near its variables, and the step that lowers it at some damping."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from backends.gauss_newton_products import Products, StartBlocks
from msnn.data.dataset import FloatArray
from msnn.training.engines.quadratic_terms import QuadraticTerms


class Model(Protocol):
    """The total near the variables."""

    @property
    def total(self) -> float:
        """F at the variables."""
        ...

    def step(self, damping: float) -> tuple[FloatArray, float]:
        """The scaled step at this damping, and how much the model of the total falls by it."""
        ...


@dataclass(frozen=True, slots=True)
class NormalEquations:
    """F, its slope 2g and curvature 2A in the raw variables, those of starts apart."""

    total: float
    slope: FloatArray
    curvature: FloatArray
    starts: StartBlocks | None

    @property
    def diagonal(self) -> FloatArray:
        """Of A: the parameters, then the starts of all runs."""
        of_parameters = np.diagonal(self.curvature)
        if self.starts is None:
            return of_parameters
        own = np.diagonal(self.starts.curvature, axis1=1, axis2=2)
        return np.concatenate([of_parameters, own.ravel()])

    def plus(self, known: QuadraticTerms) -> NormalEquations:
        """With what is known of the parameters beside the data."""
        return replace(
            self,
            total=self.total + known.value,
            slope=self.slope + known.slope,
            curvature=self.curvature + np.diag(known.curvature),
        )

    def model(self, scale: FloatArray) -> Model:
        """In variables times 1/scale."""
        if self.starts is not None:
            return ArrowModel.of(self.total, self.slope, self.curvature, self.starts, scale)
        values, vectors = np.linalg.eigh(self.curvature * np.outer(scale, scale))
        return DenseModel(self.total, self.slope * scale, np.maximum(values, 0.0), vectors)


def in_raw_variables(
    products: Mapping[str, Products], shares: Mapping[str, float], physical_by_raw: FloatArray
) -> NormalEquations:
    """The sum of the products of losses, each times its share of the total."""
    n = len(physical_by_raw)
    total, slope, curvature = 0.0, np.zeros(n), np.zeros((n, n))
    blocks: list[StartBlocks] = []
    for name, share in shares.items():
        found = products[name]
        total += share * found.cost
        slope += share * found.slope * physical_by_raw
        curvature += share * found.curvature * np.outer(physical_by_raw, physical_by_raw)
        if found.starts is not None:
            blocks.append(found.starts.scaled(share, physical_by_raw))
    starts = sum(blocks[1:], blocks[0]) if blocks else None
    return NormalEquations(total, slope, curvature, starts)


@dataclass(frozen=True, slots=True)
class DenseModel:
    """The total near the raw variables: F + 2gᵀδ + δᵀAδ, in variables scaled by 1/√D."""

    total: float
    slope: FloatArray
    curvatures: FloatArray
    """Eigenvalues of A, none below 0."""
    directions: FloatArray
    """Their eigenvectors, in columns."""

    def step(self, damping: float) -> tuple[FloatArray, float]:
        """The scaled step at this damping, and how much the model of the total falls by it."""
        along = -(self.directions.T @ self.slope) / (self.curvatures + damping)
        fall = float(np.sum(along * along * (self.curvatures + 2.0 * damping)))
        return self.directions @ along, fall


@dataclass(frozen=True, slots=True)
class ArrowModel:
    """The total near the variables, F + 2gᵀδ + δᵀAδ, where A has a block a run beside a border.

    Eliminating the starts leaves (S + μ)δ = −s for the parameters, the Schur complement
    S = A − Σ B(C + μ)⁻¹Bᵀ of the blocks C of the runs (Golub, Pereyra 1973). All variables are
    scaled by 1/√D.
    """

    total: float
    slope: FloatArray
    """Of the parameters, then of the starts."""
    curvature: FloatArray
    cross: FloatArray
    values: FloatArray
    """Eigenvalues of the blocks of the runs, none below 0."""
    directions: FloatArray

    @classmethod
    def of(
        cls,
        total: float,
        slope: FloatArray,
        curvature: FloatArray,
        blocks: StartBlocks,
        scale: FloatArray,
    ) -> ArrowModel:
        """The model of unscaled products; `scale` of the parameters, then of the starts."""
        n = len(curvature)
        top, own = scale[:n], scale[n:].reshape(blocks.slope.shape)
        values, directions = np.linalg.eigh(blocks.curvature * own[:, :, None] * own[:, None, :])
        return cls(
            total,
            np.concatenate([slope, blocks.slope.ravel()]) * scale,
            curvature * np.outer(top, top),
            blocks.cross * top[None, :, None] * own[:, None, :],
            np.maximum(values, 0.0),
            directions,
        )

    def step(self, damping: float) -> tuple[FloatArray, float]:
        """The scaled step at this damping, and how much the model of the total falls by it."""
        n = len(self.curvature)
        top, own = self.slope[:n], self.slope[n:].reshape(len(self.cross), -1)
        turned = self.cross @ self.directions
        shares = np.einsum("rni,rn->ri", self.directions, own) / (self.values + damping)
        left = turned / (self.values + damping)[:, None, :]
        complement = self.curvature - np.einsum("rpi,rqi->pq", left, turned)
        values, vectors = np.linalg.eigh(complement)
        reduced = top - np.einsum("rpi,ri->p", turned, shares)
        along = -(vectors.T @ reduced) / (np.maximum(values, 0.0) + damping)
        of_parameters = vectors @ along
        inside = -shares - np.einsum("rpi,p->ri", left, of_parameters)
        of_starts = np.einsum("rni,ri->rn", self.directions, inside)
        step = np.concatenate([of_parameters, of_starts.ravel()])
        return step, float(-(self.slope @ step) + damping * (step @ step))
