"""Lists the trials of variants: their seeds and folds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from msnn.features.comparison.trial import Trial
from msnn.features.comparison.variants import Variant
from msnn.model.load import load_model
from msnn.training.folds import fold_count


@dataclass(slots=True)
class TrialLists:
    """The trainings of each variant; the number of folds is determined once per dataset."""

    seeds: int
    folds: bool
    _counts: dict[tuple[object, ...], int] = field(
        init=False, default_factory=dict[tuple[object, ...], int]
    )

    def of(self, compared: Sequence[Variant]) -> list[Trial]:
        """All variants with the first seed, then with the next. Raises SpecError."""
        return [
            Trial(variant, seed, fold, is_costed=seed == 0 and fold in (None, 1))
            # a comparison that is interrupted has every variant by one seed, not one variant by all
            for seed in range(self.seeds)
            for variant in compared
            for fold in self._folds(variant)
        ]

    def _folds(self, variant: Variant) -> Sequence[int | None]:
        if not self.folds:
            return (None,)
        # folds are counted by reading files: once for all variants that read the same
        of_data = (setting for setting in variant.settings if setting.startswith("data"))
        key = (variant.spec, *of_data)
        if key not in self._counts:
            self._counts[key] = fold_count(load_model(variant.spec, variant.settings))
        return range(1, self._counts[key] + 1)
