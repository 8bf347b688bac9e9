"""The action and the sample repository, as the page about CI shows them."""

from __future__ import annotations

from pathlib import Path

import yaml

from tests.docs.markdown import table

_ROOT = Path(__file__).parents[2]
_SAMPLE = _ROOT / "examples" / "ci"


def action_inputs() -> str:
    """What the action may be given."""
    inputs = yaml.safe_load((_ROOT / "action.yml").read_text(encoding="utf-8"))["inputs"]
    rows = [
        (f"`{name}`", about["description"], _default(about.get("default")))
        for name, about in inputs.items()
    ]
    return table(("input", "", "default"), rows)


def sample_workflow() -> str:
    """The workflow of the sample repository."""
    return _yaml(_SAMPLE / ".github" / "workflows" / "models.yml")


def sample_hooks() -> str:
    """Its hooks before a commit."""
    return _yaml(_SAMPLE / ".pre-commit-config.yaml")


def _yaml(file: Path) -> str:
    return f"```yaml\n{file.read_text(encoding='utf-8')}```"


def _default(value: str | None) -> str:
    return f"`{value}`" if value else ""
