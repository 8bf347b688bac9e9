"""W0832 to W0834, W0837, W0838: files of recordings, their sets, and what they lack."""

import math
from collections.abc import Sequence

from msnn.errors.data.rows import seconds_text
from spec_schema.diagnostics.diagnostic import Diagnostic, remark, warning
from spec_schema.diagnostics.source import Span


def not_joined(
    *,
    before: str,
    after: str,
    seconds: float,
    columns_differ: bool,
    files: int,
    recordings: int,
    only_gaps: bool,
    span: Span | None,
) -> Diagnostic:
    """W0832: `join: true` that does not make one recording of all files."""
    if math.isnan(seconds):
        reason = f"the times of {after} and {before} cannot be compared"
    elif columns_differ:
        reason = f"the columns of {after} and {before} differ in their units or in what there is"
    elif seconds == 0:
        reason = f"{after} begins with the time at which {before} ends"
    elif seconds > 0:
        reason = f"{after} begins {seconds_text(seconds)} after the end of {before}"
    else:
        reason = f"{after} begins {seconds_text(-seconds)} before the end of {before}"
    joined = "no files" if files == recordings else f"{files} files to {recordings} recordings"
    message = f"`join: true` joins {joined}: {reason}"
    repair = (
        "a file is joined to the one that it follows by one sample; `join: false` says that each "
        "is a recording of its own"
    )
    # recordings with pauses between them, each of several files, are what loggers write
    make = remark if only_gaps and recordings < files else warning
    return make("W0832", span, message, help=repair)


def set_without_rows(
    name: str, covered: str | None, span: Span, *, before: float = 0.0, after: float = 0.0
) -> Diagnostic:
    """W0833: a set that a split names without rows, or without rows in a part of its range."""
    # seconds of its range outside of the data: none of a set without any row
    sides = ((before, "before"), (after, "after"))
    if outside := [f"{seconds_text(gap)} {side}" for gap, side in sides if gap]:
        message = (
            f"`split: {name}` asks for {' and '.join(outside)} the data, which are from {covered}"
        )
        repair = "choose times within the data if the set should be as long as its range"
        # a range may reach beyond the data on purpose, so that the last row is in it
        return remark("W0833", span, message, "partly outside of the data", help=repair)
    message = f"`split: {name}` has no rows" + (f": the data are from {covered}" if covered else "")
    repair = "make its share larger" if covered is None else "choose a time within the data"
    return warning("W0833", span, message, "no row of the data", help=repair)


def rows_in_two_sets(
    *, file: str, sets: tuple[str, str], rows: int, span: Span | None
) -> Diagnostic:
    """W0834: rows of one file that belong to two sets."""
    one, other = sets
    message = f"{file} is in the sets `{one}` and `{other}`: {rows} of its rows are in both"
    repair = "`split:` divides one set; `to:` of one and `from:` of the other part the rows"
    return warning("W0834", span, message, "the same rows again", help=repair)


def lost_messages(file: str, dropouts: Sequence[float], longest_at: float) -> Diagnostic:
    """W0837: parts of a recording that its logger lost; `dropouts` are their durations."""
    count = "1 dropout" if len(dropouts) == 1 else f"{len(dropouts)} dropouts"
    message = f"the logger of {file} lost messages: {count}, {seconds_text(sum(dropouts))} in total"
    longest = f"the longest is {seconds_text(max(dropouts))}, at {seconds_text(longest_at)}"
    repair = "with `resample: linear` an episode ends at each hole of the data"
    return warning("W0837", None, message, notes=(longest,), help=repair)


def unread_part(file: str, reason: str) -> Diagnostic:
    """W0838: a file of which a part is not read."""
    return warning("W0838", None, f"a part of {file} is not read: {reason}")
