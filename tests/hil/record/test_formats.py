"""Files of another format are refused with the number that this version reads."""

import json

import pytest

from hil.judge.verdict_files import read_verdict
from hil.record.traces import trace
from hil.scenario.files import ScenarioError, read_scenario
from hil.suite.compare_suites import read_suite

OTHER = "has format 2, and this version of vibrohil reads 1; "
SCENARIO = 'title = "It rests"\nscene = "table1-motor-soft"\nscript = { duration_s = 0.3 }\n'


def test_a_scenario_of_another_format_is_refused(tmp_path):
    path = tmp_path / "new.toml"
    path.write_text(f"format = 2\n{SCENARIO}")
    with pytest.raises(ScenarioError, match=OTHER):
        read_scenario(path)
    path.write_text(f"format = 1\n{SCENARIO}")
    assert read_scenario(path) == read_scenario(write(tmp_path / "old.toml", SCENARIO))


def write(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize(("name", "read"), [("verdict.json", read_verdict), ("suite.json", None)])
def test_a_result_of_another_format_is_refused(tmp_path, name, read):
    path = write(tmp_path / name, json.dumps({"format": 2}))
    with pytest.raises(ValueError, match=OTHER):
        read(path) if read else read_suite(tmp_path)


def test_a_trace_of_another_format_is_refused(tmp_path):
    path = tmp_path / "plant.trace"
    path.write_bytes(b"VHTRACE2" + bytes(100))
    with pytest.raises(trace.TraceError, match=r"no trace of format 1.*with the version that wrote it"):
        trace.layout_of(path)
