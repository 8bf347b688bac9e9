"""The `validate` section: what is measured of a trained model, and the limits it must keep."""

from typing import Annotated, ClassVar, Literal, TypeAlias, get_args

from pydantic import ValidationInfo, model_validator

from spec_schema.errors import schema as errors
from spec_schema.fields.entry import Entry, findings_of
from spec_schema.fields.formulas import ExpressionField
from spec_schema.fields.plain import Reference, choice
from spec_schema.fields.quantities import LengthField, QuantityField
from spec_schema.sections.data.data import Source
from spec_schema.sections.training.training import Rollout

Metric: TypeAlias = Literal["rmse", "mae", "max_abs", "r2", "fit", "fvu", "aic"]
_ELSEWHERE = {"mse": "rmse", "max": "max_abs", "vaf": "r2", "nrmse": "fit", "bic": "aic"}
"""What others call metrics, or one of the same kind: the root of mse is in the output's unit."""


class Validation(Entry):
    """A metric of an output or loss; `max` and `min` are its limits.

    It is measured over a set of the data, `data`, or over `files` of its own, for which the
    defaults of `data:` hold.
    """

    noun: ClassVar[str] = "a validate entry"

    of: Reference
    """Output or loss."""
    metric: Annotated[Metric, choice(*get_args(Metric), elsewhere=_ELSEWHERE)] = "rmse"
    """How the deviation becomes a number."""
    target: ExpressionField | None = None
    """Logged sample it is compared with; by default that of `predicts`."""
    rollout: Rollout | None = None
    """How far predictions are fed back; one step by default."""
    skip_rows: LengthField | None = None
    """First rows of each record that are not scored, wherever rollouts start."""
    data: Reference | None = None
    """Set of the data; `test` by default."""
    files: Source | None = None
    """Other files to measure on, in place of a set of the data."""
    max: QuantityField | None = None
    """Limit that the metric must not exceed."""
    min: QuantityField | None = None
    """Limit that the metric must reach."""

    @model_validator(mode="after")
    def _has_one_set(self, info: ValidationInfo) -> "Validation":
        if self.data is not None and self.files is not None:
            place = self.files.place.key
            findings_of(info).report(errors.excluded_key("files", "data", place, self.noun))
        return self
