"""Caches models and data shared by trials, so that each process reads them once."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Generic, TypeAlias, TypeVar

import numpy as np

from msnn.data.dataset import Dataset
from msnn.data.reading.frames import Frames
from msnn.features.comparison.variants import Variant
from msnn.model.load import load_model
from msnn.model.model import Model
from msnn.model.model_data import measured
from msnn.training.folds import of_fold

# trials come variant by variant: more would only hold memory
_MODELS, _TABLES = 4, 2
_SAYS_NOTHING_OF_DATA = frozenset({"parameters", "train", "validate", "export"})
"""Sections that do not affect the data read from files."""

Value = TypeVar("Value")
DataKey: TypeAlias = "tuple[Path, tuple[str, ...]]"
Folds: TypeAlias = dict[int | None, Dataset]


@dataclass(slots=True)
class Readings:
    """A cache of the most recently used models and data. Specs and files must not change meanwhile.

    `frames` and `root` are the data arguments of `measured`: tables in memory, or the folder of the
    data files.
    """

    frames: Frames | None
    root: Path | None
    _models: Latest[Model] = field(init=False)
    _tables: Latest[Folds] = field(init=False)

    def __post_init__(self) -> None:
        self._models, self._tables = Latest(_MODELS), Latest(_TABLES)

    def model(self, variant: Variant, fold: int | None) -> Model:
        """The model of a variant with this fold held out; None leaves the split of the spec. Raises
        SpecError.
        """
        key = variant.spec, variant.settings
        model = self._models.get(key, lambda: load_model(variant.spec, variant.settings))
        return model if fold is None else of_fold(model, fold)

    def data(self, variant: Variant, fold: int | None) -> Dataset:
        """The data of this variant and fold; folds share their arrays where these are equal.

        Raises SpecError for errors in spec or data, MissingExtraError for a missing package.
        """
        folds = self._tables.get(data_key(variant), dict[int | None, Dataset])
        if fold not in folds:
            model = self.model(variant, fold)
            found = measured(model, self.frames, self.root, "a comparison")
            alike = next((each for each in folds.values() if _are_equal(each, found)), None)
            # folds differ in the set of each row; the series would otherwise be in memory once a
            # fold
            folds[fold] = found if alike is None else replace(found, series=alike.series)
        return folds[fold]


def data_key(variant: Variant) -> DataKey:
    """The spec of a variant and those of its settings that can affect the data read from files.
    Variants with the same key have the same data.
    """
    deciding = (
        setting
        for setting in variant.settings
        if setting.partition("=")[0].strip().partition(".")[0] not in _SAYS_NOTHING_OF_DATA
    )
    return variant.spec, tuple(deciding)


@dataclass(slots=True)
class Latest(Generic[Value]):
    """A cache of at most `most` values; the least recently used one is dropped first."""

    most: int
    _kept: OrderedDict[Hashable, Value] = field(init=False)

    def __post_init__(self) -> None:
        self._kept = OrderedDict()

    def get(self, key: Hashable, made: Callable[[], Value]) -> Value:
        """The cached value of `key`; if there is none, it is made by calling `made`."""
        # taken out and put behind: the first one is that which was not asked for the longest
        value = self._kept.pop(key) if key in self._kept else made()
        self._kept[key] = value
        if len(self._kept) > self.most:
            self._kept.popitem(last=False)
        return value


def _are_equal(one: Dataset, other: Dataset) -> bool:
    return one.series.keys() == other.series.keys() and all(
        np.array_equal(values, other.series[name], equal_nan=True)
        for name, values in one.series.items()
    )
