"""All that a plug-in imports of msnn, by one name in the checkout and in the wheel.

docs/extending.md shows how to write, install and test a plug-in.
"""

from __future__ import annotations

from compiler.elaboration.section import CompiledSection, CompileOther, Section, SectionProblem
from compiler.ir.ops import Relation
from compiler.ir.program import Program
from compiler.ir.types import Axis
from compiler.layers.rules.plugin_layers import PluginArguments as Arguments
from compiler.layers.rules.plugin_layers import PluginContext as LayerContext
from compiler.layers.rules.plugin_layers import PluginRule as LayerRule
from compiler.layers.rules.plugin_layers import (
    read_elements,
    read_scalars,
    read_value,
    read_values,
    read_window,
)
from compiler.layers.rules.plugin_nodes import PluginBuilder as GraphBuilder
from compiler.layers.rules.plugin_nodes import PluginNode as NodeId
from compiler.linking.link import Linked
from msnn.cli.console import json_result, note, report, result
from msnn.cli.exit_codes import ExitCode
from msnn.data.formats.plugin_file import DataColumns
from msnn.errors.failures import MissingExtraError
from msnn.exports.prepare import float_plan, step_program
from msnn.exports.target import ExportPlan, Request, Target, Weights, Written
from msnn.model.model import Model
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError, error, remark, warning
from spec_schema.diagnostics.source import Span
from spec_schema.expressions.language import Signature
from spec_schema.fields.entry import Entry, LateEntry, LateObject, OneOf
from spec_schema.fields.formulas import ExpressionField
from spec_schema.fields.leaf import Located
from spec_schema.fields.plain import (
    EntriesOf,
    ManyOf,
    NewName,
    NonNegativeCount,
    NonNegativeNumber,
    PositiveCount,
    PositiveNumber,
    Reference,
    References,
    Switch,
    Text,
    choice,
)
from spec_schema.fields.quantities import (
    LengthField,
    PositiveLength,
    QuantityField,
    RangeField,
    UnitField,
)
from spec_schema.registry import (
    Feature,
    FormatLine,
    FunctionLine,
    LayerLine,
    SectionLine,
    TargetLine,
    VerbLine,
)
from spec_schema.sections.exports import FloatTargetEntry, TargetEntry
from spec_schema.sections.spec import Spec
from spec_schema.units.parser import parse_unit
from spec_schema.units.unit import Unit

__all__ = [
    "Arguments",
    "Axis",
    "CompileOther",
    "CompiledSection",
    "DataColumns",
    "Diagnostic",
    "EntriesOf",
    "Entry",
    "ExitCode",
    "ExportPlan",
    "ExpressionField",
    "Feature",
    "FloatTargetEntry",
    "FormatLine",
    "FunctionLine",
    "GraphBuilder",
    "LateEntry",
    "LateObject",
    "LayerContext",
    "LayerLine",
    "LayerRule",
    "LengthField",
    "Linked",
    "Located",
    "ManyOf",
    "MissingExtraError",
    "Model",
    "NewName",
    "NodeId",
    "NonNegativeCount",
    "NonNegativeNumber",
    "OneOf",
    "PositiveCount",
    "PositiveLength",
    "PositiveNumber",
    "Program",
    "QuantityField",
    "RangeField",
    "Reference",
    "References",
    "Relation",
    "Request",
    "Section",
    "SectionLine",
    "SectionProblem",
    "Signature",
    "Span",
    "Spec",
    "SpecError",
    "Switch",
    "Target",
    "TargetEntry",
    "TargetLine",
    "Text",
    "Unit",
    "UnitField",
    "VerbLine",
    "Weights",
    "Written",
    "choice",
    "error",
    "float_plan",
    "json_result",
    "note",
    "parse_unit",
    "read_elements",
    "read_scalars",
    "read_value",
    "read_values",
    "read_window",
    "remark",
    "report",
    "result",
    "step_program",
    "warning",
]
