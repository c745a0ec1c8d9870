"""Progress of long work, where its output goes into a pipe."""

import pytest

from tools import progress


def test_a_pipe_gets_a_line_now_and_then(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "SAID_EVERY_S", 0.0)
    with progress.shown_progress() as shown:
        shown(0.25, "trials 1/4")
        shown(None, "fitting")
    out, err = capsys.readouterr()
    assert (out, err.splitlines()) == ("", [" 25%  trials 1/4", "fitting"])


def test_lines_come_no_more_often(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "SAID_EVERY_S", 3600.0)
    with progress.shown_progress() as shown:
        for done in range(4):
            shown(done / 4, "trials")
    assert capsys.readouterr().err == ""
