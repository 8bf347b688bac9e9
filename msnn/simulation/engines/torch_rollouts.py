"""Runs rollouts step by step in torch, in float64, as an independent check."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import torch

from backends.torch_module.module import TorchModel, gathered
from compiler.interpreter.interpreter import StepValues, physical_weights
from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs
from msnn.simulation.engines.engine import StepwiseRollouts
from msnn.simulation.rollout import RolloutRow, longest_first


def torch_rollouts(
    program: Program, weights: Mapping[str, FloatArray], series: Mapping[str, FloatArray]
) -> StepwiseRollouts:
    """An engine that simulates in torch on the CPU in float64, with exactly these weights."""
    model = TorchModel(program, torch.float64, torch.device("cpu"))
    physical = {
        name: torch.from_numpy(value) for name, value in physical_weights(program, weights).items()
    }
    frame = model.frame_of(physical)
    log = {name: torch.from_numpy(np.asarray(values)) for name, values in series.items()}

    def steps(runs: Runs, losses: bool) -> Iterator[RolloutRow]:
        order = longest_first(runs)
        t0, lengths = torch.from_numpy(runs.t0[order]), runs.steps[order]
        states = model.start_on(gathered(log, t0), frame, len(t0))
        for number in range(int(lengths.max(initial=0))):
            # by falling length: those that have this step stand first
            running = int(np.searchsorted(-lengths, -number, side="left"))
            t = t0[:running] + number
            known = {name: value[:running] for name, value in states.items()}
            values = model.step_on(gathered(log, t), known, frame, running)
            states = values.next_states
            outputs = {name: value.numpy() for name, value in values.outputs.items()}
            scored = {
                name: (prediction.numpy(), None if target is None else target.numpy())
                for name, (prediction, target) in (values.losses if losses else {}).items()
            }
            # `summed` reads the factors of rows by their node, as the interpreter keeps all of them
            nodes: list[FloatArray | None] = [None] * len(program.step)
            for loss in program.losses if losses else ():
                if loss.rows is not None:
                    nodes[loss.rows] = values.rows[loss.name].numpy()
            found = StepValues(outputs, {}, scored, nodes)
            yield RolloutRow(number, order[:running], t.numpy(), found)

    return StepwiseRollouts(program, steps)
