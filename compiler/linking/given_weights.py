"""Values that trained weights give to the parameters of sub-models, and which are constants."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase

from compiler.ir.scalars.table import Array
from compiler.linking.link import Linked
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import submodels as errors
from spec_schema.errors.names import no_parameter


class GivenWeights:
    """The values that `weights:` and `freeze:` of sub-models give a parameter by its full name."""

    def __init__(self, linked: Linked, findings: Findings) -> None:
        self._use = linked.spec.use
        self._files = linked.files
        self._weights = linked.weights
        self._findings = findings
        self._missing: dict[str, list[str]] = {}

    def value(self, name: str, shape: tuple[int, ...]) -> Array | None:
        """The array of a parameter from the outermost sub-model whose weights have it."""
        owners = list(self._owners(name))
        for index, owner in enumerate(owners):
            own = name.removeprefix(f"{owner}.")
            arrays = self._weights.get(owner)
            # without `weights:` of its own a sub-model has those that its parent may give
            if arrays is None:
                continue
            if own in arrays:
                return self._fitting(owner, own, arrays[own], shape)
            # a sub-model further in that is frozen has its values in its own weights, not in these
            if not self._freezes(owners[index + 1 :], name):
                self._missing.setdefault(owner, []).append(own)
                return None
        return None

    def is_frozen(self, name: str) -> bool:
        """Whether a parameter is a constant of this model."""
        return self._freezes(self._owners(name), name)

    def settles(self, name: str) -> bool:
        """Whether the weights of a sub-model have a parameter, or it is frozen."""
        return self.is_frozen(name) or any(
            name.removeprefix(f"{owner}.") in self._weights.get(owner, {})
            for owner in self._owners(name)
        )

    def report(self, names: Iterable[str]) -> None:
        """Says what does not fit once all parameters are known."""
        names = tuple(names)
        for part, missing in self._missing.items():
            listed = ", ".join(f"`{name}`" for name in missing)
            problem = f"no values for {listed}"
            repair = "were they trained with another version of its spec?"
            place = self._place(part)
            self._findings.report(errors.unusable_weights(part, problem, place, repair))
        for part, arrays in self._weights.items():
            spec = self._files[part].spec
            # by the first word: arrays of layers and of inner sub-models have a dot
            known = {*spec.parameters, *spec.layers, *spec.use}
            extra = sorted(name for name in arrays if name.partition(".")[0] not in known)
            if extra:
                listed = ", ".join(f"`{name}`" for name in extra)
                problem = f"its spec declares no {listed}"
                repair = "were they trained with another version of its spec?"
                self._findings.report(
                    errors.unusable_weights(part, problem, self._place(part), repair)
                )
        for part, use in self._use.items():
            own = [n.removeprefix(f"{part}.") for n in names if n.startswith(f"{part}.")]
            for pattern in use.freeze.patterns:
                # `*` also suits a sub-model without parameters
                if pattern.value != "*" and not any(fnmatchcase(n, pattern.value) for n in own):
                    report = no_parameter(pattern.value, pattern.span, own)
                    self._findings.report(report)

    # ---- inside

    def _owners(self, name: str) -> Iterator[str]:
        """The sub-models that a name is in, the outermost first."""
        parts = name.split(".")
        for count in range(1, len(parts)):
            owner = ".".join(parts[:count])
            if owner in self._use:
                yield owner

    def _freezes(self, owners: Iterable[str], name: str) -> bool:
        return any(
            fnmatchcase(name.removeprefix(f"{owner}."), pattern.value)
            for owner in owners
            for pattern in self._use[owner].freeze.patterns
        )

    def _fitting(self, part: str, own: str, array: Array, shape: tuple[int, ...]) -> Array | None:
        if array.shape == shape:
            return array
        problem = f"`{own}` has the shape {list(array.shape)}, not {list(shape)}"
        place = self._place(part)
        self._findings.report(errors.unusable_weights(part, problem, place, None))
        return None

    def _place(self, part: str) -> Span:
        use = self._use[part]
        return use.weights.span if use.weights is not None else use.place.key
