"""Creates parameters and arrays of layers, with axes, units, initial values and bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId, Parameter
from compiler.ir.scalars.table import Array
from compiler.ir.training.known import Prior, Statistic
from compiler.ir.types import Axis, Type
from compiler.lowering.arrays.initial_values import initial_values
from compiler.lowering.context import Context
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.ranges import limit_in, width_in
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names
from spec_schema.sections.values import Parameter as ParameterEntry
from spec_schema.sections.values import Prior as PriorEntry
from spec_schema.units.unit import Unit


class Arrays:
    """The parameters of a model and the arrays of its layers; each is declared once."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._parameters: dict[str, Parameter] = {}
        self._failed: set[str] = set()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters of the program, in the order of first use, without frozen ones."""
        return tuple(p for p in self._parameters.values() if not self._is_constant(p))

    @property
    def all_names(self) -> tuple[str, ...]:
        """Names of all parameters, including those that frozen sub-models hold constant."""
        return tuple(self._parameters)

    def of_layer(self, layer: str) -> tuple[str, ...]:
        """Names of a layer's arrays without the prefix `layer.`."""
        owners = (name.rpartition(".") for name in self._parameters)
        return tuple(suffix for owner, _, suffix in owners if owner == layer)

    def read(self, builder: GraphBuilder, name: str) -> NodeId:
        """Returns the node of a declared parameter; a constant if its sub-model is frozen (R11)."""
        parameter = self._parameters[name]
        if not self._is_constant(parameter):
            return builder.parameter(name, Type(parameter.axes, parameter.unit))
        node = builder.constant(parameter.initial, parameter.axes, parameter.unit)
        builder.name(node, name)
        return node

    # ---- entries

    def parameter(self, name: str, entry: ParameterEntry) -> Type:
        """Returns the type of a `parameters:` entry; declares it at its first use."""
        if name in self._failed:
            raise LoweringFailed
        if name not in self._parameters:
            # the name stays if declaring raises: a mistake is reported at the first use only
            self._failed.add(name)
            self._parameters[name] = self._with_given(self._declared(name, entry))
            self._failed.remove(name)
        declared = self._parameters[name]
        return Type(declared.axes, declared.unit)

    def _declared(self, name: str, entry: ParameterEntry) -> Parameter:
        axes = self._context.axes_of(entry)
        unit = entry.unit.value if entry.unit else None
        initial = initial_values(self._context, name, entry.init, axes)
        low = None if entry.min is None else limit_in(self._context, entry.min, unit)
        high = None if entry.max is None else limit_in(self._context, entry.max, unit)
        span = entry.init.place.value
        if low is not None and high is not None and low >= high:
            assert entry.min is not None
            self._context.findings.report(
                names.unfit_constant(
                    f"`{name}`", "has no room: `min` is not below `max`", entry.min.span
                )
            )
            raise LoweringFailed
        outside = bool(
            (low is not None and np.any(initial < low))
            or (high is not None and np.any(initial > high))
        )
        if outside:
            least = "-inf" if low is None else f"{low:g}"
            most = "inf" if high is None else f"{high:g}"
            problem = f"must lie within its bounds {least} … {most}"
            self._context.findings.report(names.unfit_constant(f"`{name}`", problem, span))
            raise LoweringFailed
        return Parameter(
            name=name,
            axes=axes,
            unit=unit,
            initial=tuple(float(v) for v in initial.ravel()),
            minimum=low,
            maximum=high,
            scale=1.0 if entry.scale is None or entry.scale == "data" else entry.scale,
            learn=entry.learn,
            scales_by_data=entry.scale == "data",
            prior=self._prior(entry.prior, unit),
            doc=entry.doc or "",
            span=entry.place.key,
        )

    def _prior(self, entry: PriorEntry | None, unit: Unit | None) -> Prior | None:
        if entry is None:
            return None
        return Prior(
            limit_in(self._context, entry.mean, unit), width_in(self._context, entry.std, unit)
        )

    def declare(
        self,
        name: str,
        axes: tuple[Axis, ...],
        initial: Array,
        unit: Unit | None,
        doc: str,
        span: Span,
        bounds: tuple[float | None, float | None],
        statistic: Statistic | None = None,
    ) -> Type:
        """Declares an array of a layer, or returns its type if an earlier call declared it.

        The array is learned unless `statistic` sets it from the data.
        """
        parameter = self._parameters.get(name)
        if parameter is None:
            values = tuple(float(v) for v in initial.ravel())
            low, high = bounds
            learn = statistic is None
            parameter = Parameter(
                name=name,
                axes=axes,
                unit=unit,
                initial=values,
                minimum=low,
                maximum=high,
                scale=1.0,
                learn=learn,
                statistic=statistic,
                doc=doc,
                span=span,
            )
            parameter = self._parameters[name] = self._with_given(parameter)
        return Type(parameter.axes, parameter.unit)

    def _with_given(self, parameter: Parameter) -> Parameter:
        """The parameter, with the value from the weights of its sub-model if there are any."""
        shape = tuple(axis.size for axis in parameter.axes)
        given = self._context.given.value(parameter.name, shape)
        if given is None:
            return parameter
        values = tuple(float(value) for value in given.ravel())
        return replace(parameter, initial=values, statistic=None)  # the weights contain it

    def _is_constant(self, parameter: Parameter) -> bool:
        """True if its sub-model is frozen; a statistic without weights must first be computed."""
        return parameter.statistic is None and self._context.given.is_frozen(parameter.name)
