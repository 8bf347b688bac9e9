"""The lists of metrics have all of the language, and those in the unit of the output."""

from typing import get_args

from msnn.validation.measurement import METRICS, UNIT_METRICS
from msnn.validation.plan import metric_unit
from spec_schema.sections.training import Metric
from spec_schema.units.parser import parse_unit


def test_every_metric_is_measured():
    assert set(METRICS) == set(get_args(Metric))


def test_metrics_in_the_unit_of_the_output_are_listed_first():
    volt = parse_unit("V")
    assert tuple(metric for metric in METRICS if metric_unit(metric, volt) == volt) == UNIT_METRICS
    assert METRICS[: len(UNIT_METRICS)] == UNIT_METRICS
