"""Builds the C that an export wrote with a compiler of this machine, and runs it."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backends.c import COptions
from backends.c.host.build import CompilerFailedError, build_library
from backends.c.host.library import CStep
from backends.c.interface.interface import Interface, c_interface
from backends.files.c_compiler import CompilerMissingError
from msnn.agreement.judge import Arrays, Judgement
from msnn.errors.failures import MissingExtraError
from msnn.exports.export import ExportPlan


@contextmanager
def built_c(files: Sequence[Path], folder: Path, plan: ExportPlan) -> Generator[CModel]:
    """The model in the files that were written into `folder`, ready to run.

    What else lies in the folder is not looked at. Raises MissingExtraError without a C compiler.
    """
    with tempfile.TemporaryDirectory() as place:
        alone = Path(place) / "model"
        for file in files:
            copy = alone / file.relative_to(folder)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy)
        try:
            library = build_library(alone, Path(place) / "model.so")
        except CompilerMissingError:
            raise MissingExtraError("a C compiler", "apt install gcc, or set CC") from None
        except CompilerFailedError as error:
            raise MissingExtraError("a C compiler that accepts the export", str(error)) from None
        options = COptions(dtype=plan.dtype, prefix=plan.prefix, extras=plan.extras)
        yield CModel(CStep(alone, library), c_interface(plan.program, options))


@dataclass(frozen=True, slots=True)
class CModel:
    """One instance of the built model."""

    step: CStep
    interface: Interface

    def reset(self, judged: Judgement) -> None:
        """Sets the states from the samples around the judge's first step."""
        windows = {
            field.name: judged.window(field.name, port.first, port.last - port.first + 1).reshape(
                field.shape
            )
            for field, port in self.interface.windows
        }
        supplied = {
            field.name: judged.states[state.name][0] for field, state in self.interface.supplied
        }
        self.step.reset(windows | supplied)

    def steps(self, judged: Judgement) -> tuple[Arrays, Arrays]:
        """Outputs and next states of every step, each from the judge's states."""
        outputs: list[Arrays] = []
        following: list[Arrays] = []
        for k in range(len(next(iter(judged.outputs.values())))):
            self.step.set_states({name: values[k] for name, values in judged.states.items()})
            found, _ = self.step.step({name: v[k] for name, v in judged.inputs.items()})
            outputs.append(found)
            following.append(self.step.states())
        return _joined(outputs), _joined(following)

    def slopes(self, judged: Judgement, steps: int) -> Arrays:
        """The matrices of the Jacobian at the judge's first steps; none without a Jacobian."""
        if self.interface.jacobian is None:
            return {}
        found: list[Arrays] = []
        for k in range(steps):
            self.step.set_states({name: values[k] for name, values in judged.states.items()})
            found.append(self.step.linearize({name: v[k] for name, v in judged.inputs.items()})[0])
        return _joined(found)


def _joined(steps: list[Arrays]) -> Arrays:
    return {name: np.stack([step[name] for step in steps]) for name in steps[0]}
