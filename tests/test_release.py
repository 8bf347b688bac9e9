"""The recipe of a release refuses what does not fit together."""

import importlib.util
import json
import re
import subprocess
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
import yaml

from spec_schema.version import __version__

ROOT = Path(__file__).resolve().parent.parent


def _script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / ".ci" / f"{name}.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def release() -> Iterator[ModuleType]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / ".ci")  # as for a script that is run
        yield _script("release")


def test_the_changelog_has_a_section_for_the_version_of_the_code(release: ModuleType):
    version = release.released_version((ROOT / "spec_schema" / "version.py").read_text())
    assert version == __version__
    notes = release.release_notes((ROOT / "CHANGELOG.md").read_text(), version, tagged=False)
    assert notes.startswith(f"# msnn {version}\n\n")


@pytest.mark.parametrize("version", ["1.2", "v1.2.3", "1.2.3-beta", "next"])
def test_versions_that_installers_cannot_order_are_refused(release: ModuleType, version: str):
    with pytest.raises(release.ReleaseError, match="no version"):
        release.released_version(f'__version__ = "{version}"\n')


def test_the_notes_are_the_section_alone_and_dated_where_it_is_released(release: ModuleType):
    log = "# Changelog\n\n## 1.1.0 (not released)\n\nnew\n\n## 1.0.0 (2026-01-31)\n\nold\n"
    assert release.release_notes(log, "1.0.0", tagged=True) == "# msnn 1.0.0\n\nold\n"
    assert release.release_notes(log, "1.1.0", tagged=False) == "# msnn 1.1.0\n\nnew\n"
    with pytest.raises(release.ReleaseError, match="write the day"):
        release.release_notes(log, "1.1.0", tagged=True)
    with pytest.raises(release.ReleaseError, match=r"no section `## 2\.0\.0"):
        release.release_notes(log, "2.0.0", tagged=False)


def test_hashes_are_those_that_sha256sum_checks(release: ModuleType, tmp_path: Path):
    file = tmp_path / "a.whl"
    file.write_bytes(b"wheel")
    (tmp_path / "SHA256SUMS").write_text(release.hashes([file]))
    command = ["sha256sum", "--check", "--strict", "SHA256SUMS"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)


def test_a_commit_without_its_tag_is_refused(release: ModuleType, monkeypatch: pytest.MonkeyPatch):
    said = {"status": "", "tag": "v0.9.0"}
    monkeypatch.setattr(release, "git", lambda *arguments: said[arguments[0]])
    release.check_tag("0.9.0")
    with pytest.raises(release.ReleaseError, match=r"git tag -a v1\.0\.0"):
        release.check_tag("1.0.0")
    said["status"] = " M README.md"
    with pytest.raises(release.ReleaseError, match="changes that no commit has"):
        release.check_tag("0.9.0")


def test_a_folder_of_somebody_is_not_emptied(release: ModuleType, tmp_path: Path):
    kept = tmp_path / "thesis.tex"
    kept.write_text("mine")
    (tmp_path / "msnn-0.9.0.tar.gz").write_text("old")
    with pytest.raises(release.ReleaseError, match=r"thesis\.tex, which no release made"):
        release.clear(tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
    kept.unlink()
    release.clear(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_wheel_without_one_of_the_packages_is_refused(release: ModuleType, tmp_path: Path):
    sdist, wheel = tmp_path / "msnn-1.0.0.tar.gz", tmp_path / "msnn-1.0.0-py3-none-any.whl"
    about = "msnn-1.0.0.dist-info"
    files = ["msnn/__init__.py", "spec_schema/version.py", "compiler/ir/ops.py", "hatch_build.py"]
    with tarfile.open(sdist, "w:gz") as archive:
        for name in (*files, "CHANGELOG.md"):
            archive.addfile(tarfile.TarInfo(f"msnn-1.0.0/{name}"))

    def make(*names: str) -> None:
        with zipfile.ZipFile(wheel, "w") as archive:
            archive.writestr(f"{about}/METADATA", "Name: msnn\nVersion: 1.0.0\n")
            for name in (f"{about}/licenses/LICENSE", "msnn/py.typed", *names):
                archive.writestr(name, "")

    make("msnn/__init__.py", "msnn/spec_schema/version.py", "msnn/compiler/ir/ops.py")
    release.check_contents([sdist, wheel], "1.0.0")
    make("msnn/__init__.py", "msnn/spec_schema/version.py")
    with pytest.raises(release.ReleaseError, match=r"lacks msnn/compiler/ir/ops\.py"):
        release.check_contents([sdist, wheel], "1.0.0")


def test_the_bill_of_materials_has_every_locked_package_with_its_hashes():
    text = _script("sbom").text_of_bill(__version__)
    document = json.loads(text)
    lock = (ROOT / "requirements.lock").read_text()
    locked = dict(re.findall(r"^([a-z0-9-]+)(?:\[.*?\])?==(\S+)", lock, re.M))
    components = {each["name"]: each for each in document["components"]}
    assert {name: each["version"] for name, each in components.items()} == locked
    listed = {one["content"] for each in components.values() for one in each["hashes"]}
    assert listed == set(re.findall(r"sha256:([0-9a-f]{64})", lock))
    assert text == _script("sbom").text_of_bill(__version__)
    references = {each["bom-ref"] for each in components.values()}
    for link in document["dependencies"]:
        assert set(link["dependsOn"]) <= references, link["ref"]


def test_the_bill_of_materials_says_what_an_installation_needs():
    document = json.loads(_script("sbom").text_of_bill(__version__))
    scopes = {each["name"]: each["scope"] for each in document["components"]}
    assert scopes["numpy"] == scopes["markupsafe"] == "required"  # the second by jinja2
    assert scopes["torch"] == scopes["casadi"] == "optional"
    assert scopes["pytest"] == scopes["ruff"] == "excluded"
    licences = {each["name"]: each.get("licenses") for each in document["components"]}
    assert licences["pydantic"] == [{"expression": "MIT"}]
    assert [name for name in scopes if scopes[name] == "required" and not licences[name]] == []


def test_the_bill_of_materials_belongs_to_a_release(release: ModuleType, tmp_path: Path):
    made = tmp_path / "msnn-0.9.0.cdx.json"
    made.write_text("{}")
    assert release.is_ours(made)


def test_the_citation_is_of_this_version_and_licence():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == __version__
    assert citation["license"] == "MIT"
    assert {"cff-version", "message", "title", "authors"} <= citation.keys()
    assert "MIT License" in (ROOT / "LICENSE").read_text(encoding="utf-8")
