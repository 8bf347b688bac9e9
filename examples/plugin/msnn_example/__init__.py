"""A plug-in of msnn: its record, which the entry point in pyproject.toml names."""

from msnn.extending import (
    Feature,
    FormatLine,
    FunctionLine,
    LateEntry,
    LateObject,
    LayerLine,
    SectionLine,
    Signature,
    TargetLine,
    VerbLine,
)

FEATURE = Feature(
    name="example",
    sections=(
        SectionLine(
            "budget",
            LateEntry("msnn_example.budget", "Budget"),
            LateObject("msnn_example.budget", "BUDGET"),
            "The number of operations that a step may have.",
        ),
    ),
    targets=(
        TargetLine(
            "datasheet",
            LateEntry("msnn_example.datasheet", "DatasheetExport"),
            LateObject("msnn_example.datasheet", "TARGET"),
            "A data sheet of the model in Markdown.",
            title="data sheet",
            help="a data sheet in Markdown",
        ),
    ),
    functions=(
        FunctionLine(
            "lerp",
            Signature(3, 3, doc="a + share * (b - a), as lerp(a, b, share)."),
            LateObject("msnn_example.lerp", "lerp"),
        ),
    ),
    layers=(
        LayerLine(
            "dead_zone",
            LateEntry("msnn_example.dead_zone", "DeadZone"),
            LateObject("msnn_example.dead_zone", "DEAD_ZONE"),
            "0 within a learned width around 0, and linear outside.",
        ),
    ),
    verbs=(
        VerbLine(
            "operations",
            "Count the operations of a step by kind.",
            LateObject("msnn_example.operations", "operations"),
        ),
    ),
    formats=(
        FormatLine(
            name="JSON lines",
            suffixes=(".jsonl", ".ndjson"),
            read=LateObject("msnn_example.json_lines", "read"),
            is_text=True,
        ),
    ),
)
