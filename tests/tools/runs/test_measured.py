"""What `vibrohil measure` says of the samples that it did not receive."""

import signal
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from hil.bus import BusError
from hil.processes.signals import Interrupted, interruption
from tools import cli
from tools.output import EXIT_BAD_INPUT, BadInputError
from tools.runs.measured import LOG_NAME, log_streams, lost_samples, measure_signals, summary
from tools.xcp_master import Sample, Sampled


@pytest.mark.parametrize(
    ("ticks", "prescaler", "lost"),
    [([], 4, 0), ([7], 4, 0), ([8, 12, 16], 4, 0), ([8, 12, 20, 32], 4, 3), ([5, 6, 9], 1, 2)],
)
def test_samples_that_did_not_arrive_are_counted(ticks: list[int], prescaler: int, lost: int) -> None:
    assert lost_samples(ticks, prescaler) == lost
    assert summary("state.estimator.x_m", [0.1] * len(ticks), lost)["lost"] == lost


def test_a_log_is_never_written_through_a_link(tmp_path: Path) -> None:
    victim, folder = tmp_path / "victim", tmp_path / "out"
    victim.write_text("precious\n")
    folder.mkdir()
    (folder / LOG_NAME).symlink_to(victim)
    with pytest.raises(BadInputError, match=r"measured\.rrd exists and is kept; name another folder"):
        log_streams("local", [], folder)
    assert victim.read_text() == "precious\n"


def test_what_cannot_be_measured_leaves_no_log(tmp_path: Path) -> None:
    wanted = Sampled(["state.estimator.x_m"], 1)
    with pytest.raises(BusError, match="no hub answers"):
        measure_signals(wanted, f"local:{tmp_path}/bus", [], 1.0, False, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_signal_that_is_named_twice_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    names = ["state.estimator.x_m", "state.estimator.v_m_s", "state.estimator.x_m"]
    assert cli.run(["measure", *names, "--bus", "local"]) == EXIT_BAD_INPUT
    assert "state.estimator.x_m is named twice" in capsys.readouterr().err


class EndedBy:
    """A master that receives one sample before a signal ends the program."""

    def __init__(self, number: signal.Signals) -> None:
        self.number = number

    def start(self, lists: Sequence[Sampled]) -> None:
        assert len(lists) == 1

    def samples(self, _: Sequence[Sampled]) -> Iterator[Sample]:
        yield Sample(0, 7, (0.125,))
        raise Interrupted(interruption(self.number))


def test_ctrl_c_ends_a_measurement_with_the_figures_of_what_has_arrived(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    name = "state.estimator.x_m"

    def measured_until(number: signal.Signals) -> dict[str, dict[str, Any]]:
        monkeypatch.setattr("tools.runs.measured.session", lambda *_: nullcontext(EndedBy(number)))
        return measure_signals(Sampled([name], 1), "local", [], 60.0, False, None)

    assert measured_until(signal.SIGINT)[name]["last"] == 0.125
    with pytest.raises(Interrupted, match="SIGTERM"):
        measured_until(signal.SIGTERM)
