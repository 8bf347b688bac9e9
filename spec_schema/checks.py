"""The `validate` section: what is measured of a trained model, and the limits it must keep."""

from typing import Annotated, ClassVar, Literal, TypeAlias

from spec_schema.entry import Entry
from spec_schema.expression_fields import ExpressionField
from spec_schema.plain_fields import Reference, choice
from spec_schema.quantity_fields import QuantityField
from spec_schema.training import Rollout

Metric: TypeAlias = Literal["rmse", "mae", "max_abs", "r2", "fit", "fvu", "aic"]


class Check(Entry):
    """A metric of an output or loss over a set of the data; `max` and `min` are its limits."""

    noun: ClassVar[str] = "a validate entry"
    later: ClassVar[frozenset[str]] = frozenset({"files"})

    of: Reference
    metric: Annotated[Metric, choice("rmse", "mae", "max_abs", "r2", "fit", "fvu", "aic")] = "rmse"
    target: ExpressionField | None = None
    rollout: Rollout | None = None
    data: Reference | None = None
    max: QuantityField | None = None
    min: QuantityField | None = None
