"""A run says where it comes from: the commit, what was edited since, what was changed over its scenario."""

import json
import os
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest
from resting import resting

import compilation
import hil
from hil.record import provenance


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("provenance")
    return hil.run(resting(folder), set={"script.duration_s": 0.2}, seed=3, out=folder / "run")


def test_a_run_names_its_commit_and_its_changes(run):
    here = Path(provenance.__file__).parent
    head = subprocess.run(
        ["git", "-C", here, "rev-parse", "HEAD"], capture_output=True, text=True, check=False
    )
    document = json.loads((run.folder / "run.json").read_text())
    assert document["commit"] == (head.stdout.strip() or None)
    assert document["changes"] == ["script.duration_s=0.2"]
    assert run.verdict["provenance"] == {key: document[key] for key in provenance.KEYS}


def test_report_and_junit_say_so_too(run):
    assert "with script.duration_s=0.2" in (run.folder / "report.html").read_text()
    suite = ElementTree.parse(run.folder / "junit.xml").getroot()[0]
    origin = {one.get("name"): one.get("value") for one in suite.findall("properties/property")}
    assert origin["changes"] == "['script.duration_s=0.2']"
    assert origin["seed"] == "3"


def test_outside_of_a_checkout_there_is_no_commit(monkeypatch):
    monkeypatch.setattr(provenance, "git", lambda *_: None)
    assert provenance.commit.__wrapped__() == {"commit": None, "edited": None}


def test_asking_for_edits_takes_no_lock_of_the_repository(monkeypatch, tmp_path):
    """An interrupted run would kill git and leave the lock there, and nobody could commit any more."""
    (tmp_path / "code.py").write_text("one = 1\n")
    for command in (["init", "-q"], ["add", "code.py"]):
        subprocess.run(["git", "-C", tmp_path, *command], check=True)
    index = tmp_path / ".git" / "index"
    os.utime(tmp_path / "code.py", (0, 0))  # a status would now refresh the index, if it took its lock
    before = index.read_bytes()
    monkeypatch.setattr(provenance, "__file__", str(tmp_path / "code.py"))
    assert provenance.git("status", "--porcelain") == "A  code.py"
    assert index.read_bytes() == before


def test_an_edit_of_any_file_changes_the_digest_of_the_sources(monkeypatch, tmp_path):
    here = Path(provenance.__file__)
    root = here.parents[2]
    for part in compilation.PACKAGES:
        shutil.copytree(root / part, tmp_path / part, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(provenance, "__file__", str(tmp_path / here.relative_to(root)))
    found = {provenance.sources.__wrapped__()}
    folders = {path.parent: path for path in sorted(tmp_path.rglob("*")) if path.is_file()}
    for number, path in enumerate(folders.values(), start=1):
        with path.open("ab") as file:
            file.write(b"\n")
        found.add(provenance.sources.__wrapped__())
        assert len(found) == number + 1, path
    assert len(folders) > 50
