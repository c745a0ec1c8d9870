"""What `vibrohil measure` says of the samples that it did not receive."""

from pathlib import Path

import pytest

from hil.bus.opening import BusError
from hil.bus.xcp_master import Sampled
from tools.logs.measured import LOG_NAME, log_streams, lost_samples, measured, summary
from tools.output import BadInputError


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
        measured(wanted, f"local:{tmp_path}/bus", [], 1.0, False, tmp_path / "out")
    assert not (tmp_path / "out").exists()
