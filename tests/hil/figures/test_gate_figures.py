"""What contacts reach before the torque ends, on made-up records with known answers."""

from collections.abc import Sequence

import numpy as np
import pytest
from run_folder import records

from hil.figures.gate import CLEAR_S, REACTION_S, WATCHED_S, gate_figures
from hil.record.run_faults import RunFault
from hil.record.run_traces import RunTraces

T_S = 0.001
CONTACTS_S = (0.1, 0.3)
LASTS_S = 0.02


def gate_of(
    off_from_s: float = 1.0,
    kick_at_s: float | None = None,
    force_n: float = 200.0,
    frames: Sequence[str] = (),
    ticks: int = 600,
):
    """Two contacts of 20 ms with a constant force, 10 N and then 200 N; the torque ends at a time."""
    t_s = T_S * np.arange(ticks)
    forces_n = [
        one * ((t_s >= at_s) & (t_s < at_s + LASTS_S - 0.5 * T_S))
        for one, at_s in zip((10.0, 200.0), CONTACTS_S, strict=True)
    ]
    kick = RunFault("kick", None, False, kick_at_s or 0.0, kick_at_s, "kick", frames=frames)._asdict()
    traces = RunTraces(
        plant=records(t_s=t_s, stop_force_n=sum(forces_n)),
        firmware=records(t_s=t_s, outputs__torque_n_m=np.where(t_s < off_from_s - 0.5 * T_S, 0.1, 0.0)),
        impacts=records(t_s=np.array(CONTACTS_S) - 0.5 * T_S, peak_force_n=np.array([10.0, force_n])),
        run={"faults": [] if kick_at_s is None else [kick]},
    )
    return gate_figures(traces)


def test_a_contact_under_torque_counts_as_a_whole() -> None:
    found = gate_of()
    assert found.passed_n == 200.0
    assert found.passed_n_s == pytest.approx(200.0 * (LASTS_S - T_S))


def test_what_a_contact_reaches_after_the_torque_has_ended_does_not_count() -> None:
    """It ends 11 ms after the touch-down, and what the last 4 ms of torque brought is not counted either."""
    found = gate_of(CONTACTS_S[1] + 0.011)
    assert found.passed_n == 200.0
    assert found.passed_n_s == pytest.approx(200.0 * (0.010 - REACTION_S))
    assert gate_of(CONTACTS_S[1] + REACTION_S).passed_n == 10.0
    assert gate_of(0.05) == gate_of(0.0)
    assert gate_of(0.05).passed_n == 0.0
    assert CONTACTS_S[1] - CONTACTS_S[0] > WATCHED_S, "the torque of a later start is none of this contact's"


@pytest.mark.parametrize(
    ("at_s", "passed_n"),
    [
        (CONTACTS_S[1] - CLEAR_S + T_S, 10.0),
        (CONTACTS_S[1] - CLEAR_S - T_S, 200.0),
        (CONTACTS_S[1] + LASTS_S + CLEAR_S - 2.0 * T_S, 10.0),
        (CONTACTS_S[1] + LASTS_S + CLEAR_S + T_S, 200.0),
    ],
)
def test_a_contact_near_a_fault_does_not_count(at_s: float, passed_n: float) -> None:
    assert gate_of(kick_at_s=at_s).passed_n == passed_n


def test_a_fault_of_other_frames_hides_no_contact() -> None:
    at_s = CONTACTS_S[1]
    assert gate_of(kick_at_s=at_s, frames=["OperatorCommand"]).passed_n == 200.0
    assert gate_of(kick_at_s=at_s, frames=["Gait", "Accelerometer"]).passed_n == 10.0


def test_a_contact_that_is_open_at_the_end_counts() -> None:
    assert gate_of(ticks=305).passed_n == 200.0


def test_a_rigid_stop_has_no_force_to_judge_and_no_firmware_no_torque() -> None:
    assert gate_of(force_n=np.nan).passed_n is None
    assert (
        gate_figures(RunTraces(plant=records(t_s=np.arange(3.0), stop_force_n=np.ones(3)))).passed_n is None
    )
