"""The page of a run as a file: one file, what it may load, what of a spec it lets be markup."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from msnn.api import models, trainings
from msnn.api.reports import WrittenReport, report
from msnn.features.report_page.packing import thinned
from msnn.features.report_page.page import marked
from spec_schema.diagnostics.diagnostic import SpecError
from tests.reports.conftest import HOSTILE


@pytest.fixture(scope="session")
def html(written: WrittenReport) -> str:
    return written.path.read_text(encoding="utf-8")


class _Elements(HTMLParser):
    """Collects elements and attributes as a browser would see them."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


def test_it_is_one_file_that_may_load_nothing(html: str):
    elements = _Elements(html).found
    assert {tag for tag, _ in elements}.isdisjoint({"link", "img", "iframe", "object", "base"})
    assert not any(
        {"src", "href"} & set(at) and "#" not in str(at.get("href")) for _, at in elements
    )
    assert not any(name.startswith("on") or name == "style" for _, at in elements for name in at)
    (policy,) = [at["content"] for tag, at in elements if at.get("http-equiv") and tag == "meta"]
    assert str(policy).startswith("default-src 'none'; script-src 'sha256-")
    (style,) = re.findall(r"<style>(.*?)</style>", html, re.S)
    (script,) = re.findall(r"<script>(.*?)</script>", html, re.S)
    for text in (style, script):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in str(policy)


def test_what_a_spec_or_a_file_name_says_is_text(html: str):
    assert HOSTILE not in html
    assert "&lt;/script&gt;&lt;img" in html
    assert html.count("</script>") == 2
    assert any(each["name"].startswith("a<b>\"&'.csv", 10) for each in data_of(html)["records"])


@pytest.mark.parametrize(
    ("said", "markup"),
    [
        ("`<b>` needs `x_1` & y", "<code>&lt;b&gt;</code> needs <code>x_1</code> &amp; y"),
        ("one ` and <b>", "one ` and &lt;b&gt;"),
    ],
)
def test_what_messages_quote_is_code_and_still_text(said: str, markup: str):
    assert str(marked(said)) == markup


def test_records_of_the_test_set_come_first(html: str):
    names = [record["name"].rpartition(" · ")[2] for record in data_of(html)["records"]]
    assert names == sorted(names, key=["test", "val", "train"].index)
    assert set(names) == {"test", "val", "train"}


def test_it_shows_parameters_limits_and_equations(html: str):
    for text in ("± std. error", "N*s/m", "limits of the spec kept", "<math", "Architecture of"):
        assert text in html


def test_without_zig_the_model_does_not_run_and_the_page_says_so(
    trained_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("msnn.packages.OptionalPackage.is_installed", False)
    written = report(trained_run, tmp_path / "page.html")
    assert not written.is_live
    (warning,) = [each for each in written.warnings if each.code == "W0809"]
    assert "ziglang" in warning.message
    assert (warning.help or "").startswith("pip install ")
    assert "[zig]'" in (warning.help or "")
    assert data_of(written.path.read_text(encoding="utf-8"))["live"] is None


def test_without_data_the_model_still_runs(trained_run: Path, tmp_path: Path):
    written = report(trained_run, tmp_path / "page.html", data_root=tmp_path)
    assert {each.code for each in written.warnings} == {"W0809"}
    assert data_of(written.path.read_text(encoding="utf-8"))["records"] == []


def test_a_run_of_frames_has_the_records_that_are_handed_over(tmp_path: Path):
    spec = {
        "msnn": 1,
        "name": "gain",
        "sample_time": "0.1 s",
        "inputs": {"u": "N"},
        "targets": {"y": "N"},
        "parameters": {"k": 1.0},
        "outputs": {"out": {"expr": "k * u", "predicts": "y[t]", "unit": "N"}},
        "train": [{"epochs": 1, "optimizer": {"adam": {}}}],
    }
    u = np.linspace(-1.0, 1.0, 50)
    frames = {"u": u, "y": 2.0 * u}
    result = trainings.train(models.load(spec), frames, runs=tmp_path / "runs")
    assert result.folder is not None
    (lacks,) = [each for each in report(result.folder).warnings if "records" in each.message]
    assert "given its data in Python" in lacks.message
    assert "msnn.report(run, data=frames)" in (lacks.help or "")
    written = report(result.folder, data=frames)
    assert not any("records" in each.message or "data" in each.message for each in written.warnings)
    assert len(data_of(written.path.read_text(encoding="utf-8"))["records"]) == 1
    others = report(result.folder, data={"u": u, "y": u})
    assert any("those that were given are others" in each.message for each in others.warnings)


def test_the_page_of_a_model_in_fixed_point_says_why_the_model_does_not_run(tmp_path: Path):
    spec = {
        "msnn": 1,
        "name": "gain",
        "sample_time": "0.1 s",
        "inputs": {"u": {"unit": "N", "range": [-1, 1]}},
        "targets": {"y": "N"},
        "parameters": {"k": 1.0},
        "outputs": {"out": {"expr": "k * u", "predicts": "y[t]", "unit": "N"}},
        "train": [{"epochs": 1, "optimizer": {"adam": {}}}],
        "export": {"c": {"dtype": "q15"}},
    }
    frames = {"u": np.linspace(-1.0, 1.0, 50), "y": np.linspace(-2.0, 2.0, 50)}
    result = trainings.train(models.load(spec), frames, runs=tmp_path / "runs")
    assert result.folder is not None
    written = report(result.folder, data=frames)
    (warning,) = written.warnings
    assert (warning.code, "fixed point" in warning.message) == ("W0809", True)
    page = data_of(written.path.read_text(encoding="utf-8"))
    assert len(page["records"]) == 1


def test_a_warning_of_training_and_data_is_shown_once(tmp_path: Path):
    spec = {
        "msnn": 1,
        "name": "gain",
        "sample_time": "0.1 s",
        "inputs": {"u": {"unit": "N", "range": [0, 5]}},
        "targets": {"y": "N"},
        "parameters": {"k": 1.0},
        "outputs": {"out": {"expr": "k * u", "predicts": "y[t]", "unit": "N"}},
        "train": [{"epochs": 1, "optimizer": {"adam": {}}}],
    }
    frames = {"u": np.linspace(-1.0, 1.0, 50), "y": np.linspace(-2.0, 2.0, 50)}
    result = trainings.train(models.load(spec), frames, runs=tmp_path / "runs")
    assert result.folder is not None
    page = report(result.folder, data=frames).path.read_text(encoding="utf-8")
    assert len(re.findall(r"<li>[^\n]*outside its range", page)) == 1


def test_what_is_no_verification_is_refused(trained_run: Path, tmp_path: Path):
    other = tmp_path / "other.json"
    other.write_text('{"results": [{}]}', encoding="utf-8")
    with pytest.raises(SpecError) as caught:
        report(trained_run, tmp_path / "page.html", verification=other)
    assert [each.code for each in caught.value.diagnostics] == ["E0853"]


def test_a_verification_is_shown(trained_run: Path, tmp_path: Path):
    file = tmp_path / "verification.json"
    found = {"check": "builds", "target": "host", "detail": "gcc <12>", "verdict": "ok"}
    file.write_text(json.dumps({"model": "plant", "results": [found]}), encoding="utf-8")
    written = report(trained_run, tmp_path / "page.html", verification=file)
    assert "gcc &lt;12&gt;" in written.path.read_text(encoding="utf-8")


def test_no_check_of_a_long_verification_is_left_out(trained_run: Path, tmp_path: Path):
    file = tmp_path / "verification.json"
    found = [{"check": f"c{i}", "target": "host", "detail": "", "verdict": "ok"} for i in range(90)]
    found[-1] |= {"verdict": "found", "detail": "an overflow"}
    file.write_text(json.dumps({"model": "plant", "results": found}), encoding="utf-8")
    written = report(trained_run, tmp_path / "page.html", verification=file)
    assert "an overflow" in written.path.read_text(encoding="utf-8")


def test_data_that_changed_since_the_training_are_told(trained_run: Path, tmp_path: Path):
    data = tmp_path / "data"
    shutil.copytree(trained_run.parents[2] / "data", data)
    same = report(trained_run, tmp_path / "page.html", data_root=tmp_path)
    assert not any("data of the training" in each.message for each in same.warnings)
    record = next((data / "train").glob("*.csv"))
    header, first, *rows = record.read_text(encoding="utf-8").splitlines()
    time, force, *rest = first.split(",")
    changed = ",".join([time, str(float(force) + 1), *rest])
    record.write_text("\n".join([header, changed, *rows]) + "\n", encoding="utf-8")
    written = report(trained_run, tmp_path / "page.html", data_root=tmp_path)
    assert any("data of the training" in each.message for each in written.warnings)
    assert "no data of the training" in written.path.read_text(encoding="utf-8")


def test_thinning_keeps_every_peak_in_its_order():
    values = np.array([0.0, 5.0, -1.0, 2.0, np.nan, 3.0, np.nan, np.nan, np.nan])
    found = thinned(values, 3)
    assert found["every"] == 1.5
    known = np.frombuffer(base64.b64decode(found["f32"]), "<f4")
    assert np.array_equal(known, [5, -1, 2, 3, np.nan, np.nan], equal_nan=True)


def data_of(html: str) -> dict[str, Any]:
    (text,) = re.findall(r'id="data">(.*?)</script>', html, re.S)
    return json.loads(text)


def test_what_is_no_run_is_named(trained_run: Path, tmp_path: Path):
    spec = trained_run.parents[2] / "plant.msnn.yaml"
    for path in (tmp_path, spec):
        with pytest.raises(SpecError) as caught:
            report(path)
        assert [each.code for each in caught.value.diagnostics] == ["E0980"]


def test_a_run_without_weights_has_no_page(trained_run: Path, tmp_path: Path):
    shutil.copytree(trained_run.parent, tmp_path / "runs")
    copy = tmp_path / "runs" / trained_run.name
    (copy / "weights.safetensors").unlink()
    with pytest.raises(SpecError):
        report(copy)
    assert not (copy / "report.html").exists()
