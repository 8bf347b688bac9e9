"""A plug-in of msnn: its record, which the entry point in pyproject.toml names."""

from msnn.extending import Feature, LateEntry, LateObject, SectionLine, TargetLine

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
)
