"""Writes the bill of materials of a release: the locked packages, as CycloneDX 1.5 in JSON.

    python .ci/sbom.py [FILE]     to stdout without a file

Names, versions, hashes and direct dependencies are those of `requirements.lock`; licences are what
the installed packages state. `scope` is `required` for the light installation, `optional` for an
extra, and `excluded` for packages that only development needs.
"""

import json
import re
import sys
import tomllib
import uuid
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, metadata, requires
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent
LOCK = ROOT / "requirements.lock"
PROJECT = ROOT / "pyproject.toml"
_BLOCK = re.compile(r"^([\w.-]+)(?:\[[^\]]*\])?==(\S+)[^\n]*\n((?:[ \t].*\n)*)", re.MULTILINE)


def bill(lock: str, project: Mapping[str, Any], version: str) -> dict[str, Any]:
    """The document. `lock` is the text of the lock, `project` the table `[project]`."""
    locked = {canonicalize_name(found[1]): found for found in _BLOCK.finditer(lock)}
    extras = [one for group in project["optional-dependencies"].values() for one in group]
    direct = [one for one in [*project["dependencies"], *extras] if not one.startswith("msnn[")]
    required, optional = _closure(project["dependencies"]), _closure(direct)

    def reference(name: str) -> str:
        return f"pkg:pypi/{name}@{locked[name][2]}"

    components = [
        {
            "type": "library",
            "bom-ref": reference(name),
            "name": name,
            "version": found[2],
            "purl": reference(name),
            "scope": _scope(name, required, optional),
            **_licences(name),
            "hashes": [
                {"alg": "SHA-256", "content": digest}
                for digest in re.findall(r"sha256:([0-9a-f]{64})", found[3])
            ],
        }
        for name, found in sorted(locked.items())
    ]
    own = f"pkg:pypi/msnn@{version}"
    links = {own: sorted({canonicalize_name(Requirement(one).name) for one in direct})}
    links |= {reference(name): sorted(_needs(name)) for name in sorted(locked)}
    document: dict[str, Any] = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": own,
                "name": "msnn",
                "version": version,
                "purl": own,
                "licenses": [{"license": {"id": project["license"]}}],
            }
        },
        "components": components,
        "dependencies": [
            {"ref": ref, "dependsOn": [reference(name) for name in names if name in locked]}
            for ref, names in links.items()
        ],
    }
    # the same content has the same number
    content = json.dumps(document, sort_keys=True)
    document["serialNumber"] = f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, content)}"
    return document


def _scope(name: str, required: set[str], optional: set[str]) -> str:
    return "required" if name in required else "optional" if name in optional else "excluded"


def _closure(requirements: Iterable[str]) -> set[str]:
    """The packages that these requirements install here, directly or by others."""
    names: set[str] = set()
    ahead = list(_names(requirements))
    while ahead:
        name = ahead.pop()
        if name not in names:
            names.add(name)
            ahead += _needs(name)
    return names


def _needs(name: str) -> set[str]:
    try:
        return _names(requires(name) or ())
    except PackageNotFoundError:  # of another system
        return set()


def _names(requirements: Iterable[str]) -> set[str]:
    read = map(Requirement, requirements)
    installed = (one for one in read if one.marker is None or one.marker.evaluate({"extra": ""}))
    return {canonicalize_name(one.name) for one in installed}


def _licences(name: str) -> dict[str, Any]:
    """The licence of an installed package: its SPDX expression, else the words that it states."""
    try:
        stated = metadata(name)
    except PackageNotFoundError:
        return {}
    if stated.get("License-Expression"):
        return {"licenses": [{"expression": stated["License-Expression"]}]}
    classifiers = [
        line.rpartition(" :: ")[2]
        for line in stated.get_all("Classifier") or ()
        if line.startswith("License :: ") and not line.endswith("OSI Approved")
    ]
    text = (stated.get("License") or "").strip().partition("\n")[0][:80]
    names = classifiers or ([text] if text else [])
    return {"licenses": [{"license": {"name": each}} for each in names]} if names else {}


def text_of_bill(version: str) -> str:
    """The document of this checkout as JSON."""
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    return json.dumps(bill(LOCK.read_text(encoding="utf-8"), project, version), indent=1) + "\n"


if __name__ == "__main__":
    version = (ROOT / "spec_schema" / "version.py").read_text(encoding="utf-8")
    found = re.search(r'^__version__ = "(.+)"$', version, re.MULTILINE)
    assert found
    text = text_of_bill(found[1])
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text(text, encoding="utf-8")
    else:
        sys.stdout.write(text)
