"""The operator's consent: which of the commands that arrive count."""

import pytest
from closed_loop import CONSENT_S, Bench
from records import HEALTHY

from firmware_py.core.safety import consent
from firmware_py.core.safety.consent import ConsentState
from firmware_py.interface import codec
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import Fault, Mode, OperatorRequest
from firmware_py.interface.generated.records import DriveEstop
from firmware_py.shell.parameters import config_from

CONFIG = config_from({})
LEAST = CONFIG.consent.repeated_ticks
LETTERS = dict(zip("IRCP", OperatorRequest, strict=True))


def after(steps: str) -> list[str]:
    """The request that counts after each step: a command 100 ticks after the one before, by its letter.

    `!`: a command out of sequence. `~`: silence. `|`: READY, FAULT or E_STOP begins.
    """
    state, asked, counted = consent.INITIAL, HEALTHY.operator, []
    for letter in steps:
        if letter == "|":
            state = consent.end(state)
        elif letter == "!":
            state = consent.step(CONFIG.consent, state, asked._replace(age_ticks=1, stray_ticks=0))
        elif letter == "~":
            state = consent.step(CONFIG.consent, state, asked._replace(age_ticks=351))
        else:
            for age_ticks in (*range(1, 100), 0):
                request = LETTERS[letter] if age_ticks == 0 else asked.request
                asked = asked._replace(request=request, age_ticks=age_ticks, stray_ticks=NEVER_TICKS)
                state = consent.step(CONFIG.consent, state, asked)
        counted.append(state.request.name[0])
    return counted


@pytest.mark.requirement("S-07", "S-13")
@pytest.mark.parametrize(
    ("steps", "counted"),
    [
        ("IRRRRRI", "IIIIRRI"),  # a change, repeated three times; a stop counts at once
        ("RRRRRR", "IIIIII"),  # no change was seen
        ("CCCCRRRRR", "IIIIIIIII"),  # RUN only after IDLE
        ("ICCCCPPPP", "IIIICIIII"),  # so the test of the drive's watchdog
        ("IPPPPCCCC", "IIIIPIIIC"),  # CLEAR_FAULTS after anything
        ("IRRRRCCCCC", "IIIIRIIICC"),
        ("IRR!RRRRRRR", "IIIIIIIIIII"),  # disputed before it counts,
        ("IRRRR!RRRRR", "IIIIRIIIIII"),  # and afterwards
        ("IRRRR!IRRRR", "IIIIRIIIIIR"),  # another change counts again
        ("IRRRR~RRRRR", "IIIIRIIIIII"),  # so after a silence
        ("IRRRR|RRRRR", "IIIIRIIIIII"),  # and in a mode that begins
        ("IRR|RRRR|IRRRR", "IIIIIIIIIIIIIR"),
        ("I|RRRR", "IIIIIR"),
    ],
)
def test_which_request_counts(steps: str, counted: str) -> None:
    assert "".join(after(steps)) == counted


def test_a_request_counts_after_the_longest_silence_less_the_time_to_arm() -> None:
    assert LEAST == 350 - 60
    state = ConsentState(OperatorRequest.IDLE, OperatorRequest.RUN, -1)
    for asked_ticks, age_ticks, counts in ((-2, 0, False), (-1, 0, True), (-1, 1, False), (9, 0, True)):
        found = consent.step(
            CONFIG.consent,
            state._replace(asked_ticks=LEAST + asked_ticks),
            HEALTHY.operator._replace(request=OperatorRequest.RUN, age_ticks=age_ticks),
        )
        assert (found.request == OperatorRequest.RUN) == counts
    operator = HEALTHY.operator._replace(request=OperatorRequest.RUN)
    for age_ticks, last in ((350, OperatorRequest.RUN), (351, OperatorRequest.IDLE)):
        running = ConsentState(OperatorRequest.RUN, OperatorRequest.RUN, LEAST)
        assert consent.step(CONFIG.consent, running, operator._replace(age_ticks=age_ticks)).request == last


@pytest.mark.requirement("S-13")
@pytest.mark.parametrize("held", [OperatorRequest.RUN, OperatorRequest.CLEAR_FAULTS])
def test_a_request_that_is_held_through_a_fault_counts_no_more(held: OperatorRequest) -> None:
    """An E-stop, a clear, and a start: each needs a request of its own."""
    bench = Bench({"start.rise_s": 0.5, "start.stop_s": 0.3})
    bench.run(0.2)
    bench.request = held
    bench.run(0.5)
    change = bench.change
    bench.change = lambda _, frames: [*frames, codec.encode(DriveEstop())]
    bench.run(0.001)
    bench.change = change
    bench.run(1.0, keep=False)
    assert bench.mode == Mode.E_STOP
    for request, seconds, mode in (
        (OperatorRequest.IDLE, 0.5, Mode.E_STOP),
        (OperatorRequest.CLEAR_FAULTS, CONSENT_S - 0.1, Mode.E_STOP),
        (OperatorRequest.CLEAR_FAULTS, 1.0, Mode.READY),
        (OperatorRequest.RUN, 1.0, Mode.READY),
        (OperatorRequest.IDLE, 0.3, Mode.READY),
        (OperatorRequest.RUN, CONSENT_S - 0.1, Mode.READY),
        (OperatorRequest.RUN, 0.2, Mode.SOFT_START),
    ):
        bench.request = request
        bench.run(seconds, keep=False)
        assert (bench.mode, bench.node.outputs.fault) == (mode, Fault.NONE), request.name


def test_a_request_counts_in_the_first_tick_that_is_late_enough() -> None:
    asked = HEALTHY.operator._replace(age_ticks=0, stray_ticks=NEVER_TICKS)
    state = consent.step(CONFIG.consent, consent.INITIAL, asked._replace(request=OperatorRequest.IDLE))
    counted = 0
    for tick in range(LEAST + 1):
        state = consent.step(CONFIG.consent, state, asked._replace(request=OperatorRequest.RUN))
        counted += state.request == OperatorRequest.RUN
        assert counted == (tick == LEAST)
