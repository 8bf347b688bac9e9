"""All records: one an operation of the IR and one a row of the table of scalar functions."""

from __future__ import annotations

from tests.every_op.axes_records import axes_records
from tests.every_op.elementwise_records import elementwise_records
from tests.every_op.function_records import function_records
from tests.every_op.leaf_records import leaf_records
from tests.every_op.record import Record

FUNCTION_RECORDS: dict[str, Record] = function_records()

OP_RECORDS: dict[str, Record] = {**leaf_records(), **elementwise_records(), **axes_records()}
"""By the operation's name; those of `Compare` are followed by the relation."""

RECORDS: tuple[Record, ...] = (*OP_RECORDS.values(), *FUNCTION_RECORDS.values())
