"""Compiles exported C with a local compiler, and runs it."""

from __future__ import annotations

import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backends.c.host.build import CompilerFailedError, build_library
from backends.c.host.library import CStep
from backends.c.interface.interface import Interface
from backends.files.atomic_write import naming
from backends.files.c_compiler import CompilerMissingError
from msnn.agreement.judgement import Arrays, Beginning, ExportedSlopes, Loaded, stacked
from msnn.errors.failures import MissingExtraError, UnfitCompilerError
from msnn.exports.target import Written


@contextmanager
def built_c(written: Written) -> Generator[CStep]:
    """A context with one instance of the exported C, compiled for this machine and loaded.

    Raises MissingExtraError without a suitable C compiler.
    """
    with built_folder(written, "model.so") as folder:
        yield CStep.of_folder(folder, folder / "model.so")


@contextmanager
def built_folder(written: Written, library: str) -> Generator[Path]:
    """A temporary folder with only the written files and the built `library`.

    Raises MissingExtraError without a suitable C compiler.
    """
    # Windows does not remove a library that is loaded
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as place:
        alone = Path(place)
        # the folder of an export may hold files of others, which would be compiled too
        for file in written.files:
            copy = alone / file.relative_to(written.folder)
            copy.parent.mkdir(parents=True, exist_ok=True)
            with naming(copy):
                copy.write_bytes(file.read_bytes())
        try:
            build_library(alone, alone / library)
        except CompilerMissingError:
            raise MissingExtraError("a C compiler", "apt install gcc, or set CC") from None
        except CompilerFailedError as error:
            raise UnfitCompilerError(error.compiler, error.said, error.remedy) from None
        yield alone


def loaded_c(step: CStep, interface: Interface) -> Loaded:
    """One instance of compiled C in the form that comparisons need; with Jacobian if the export has
    one.
    """
    model = _CModel(step, interface)
    matrices = interface.jacobian
    slopes = None if matrices is None else ExportedSlopes(matrices.jacobian, model.slopes)
    return Loaded(model.run, model.start, model.step_each, lambda: slopes)


@dataclass(frozen=True, slots=True)
class _CModel:
    step: CStep
    interface: Interface

    def start(self, beginning: Beginning) -> Arrays:
        """The initial states that `reset` computes from the samples around the first step."""
        windows = {
            field.name: beginning.window(
                field.name, port.first, port.last - port.first + 1
            ).reshape(field.shape)
            for field, port in self.interface.windows
        }
        supplied = {
            field.name: beginning.states[state.name] for field, state in self.interface.supplied
        }
        # what the log says of buffers, and values of states that only a caller knows
        self.step.reset(windows | supplied)
        return {name: value[np.newaxis] for name, value in self.step.states().items()}

    def run(self, beginning: Beginning, inputs: Arrays, steps: int) -> Arrays:
        """Simulates `steps` steps by one call of the C code; returns the outputs, (steps,
        *shape).
        """
        self.start(beginning)
        return self.step.run(inputs, steps)[0]

    def step_each(self, inputs: Arrays, states: Arrays, steps: int) -> tuple[Arrays, Arrays]:
        outputs: list[Arrays] = []
        following: list[Arrays] = []
        for k in range(steps):
            self.step.set_states({name: values[k] for name, values in states.items()})
            found, _ = self.step.step({name: values[k] for name, values in inputs.items()})
            outputs.append(found)
            following.append(self.step.states())
        return stacked(outputs), stacked(following)

    def slopes(self, inputs: Arrays, states: Arrays, steps: int) -> Arrays:
        found: list[Arrays] = []
        for k in range(steps):
            self.step.set_states({name: values[k] for name, values in states.items()})
            slopes, _ = self.step.linearize({name: values[k] for name, values in inputs.items()})
            found.append(slopes)
        return stacked(found)
