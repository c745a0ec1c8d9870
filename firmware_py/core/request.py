"""What start and hold are asked to do: by the operator, or by the gait in the operator's place."""

from typing import NamedTuple

from firmware_py.interface.enums import Refusal


class Request(NamedTuple):
    """A ratio to start to and to hold, and an impulse (0: none is requested).

    `sets_hold_ratio`: whoever asks sets the ratio during the hold too, by `trim` (its difference from
    `ratio`) and its rate; neither `hold` nor a retreat changes it. `refusal`: why whoever asks cannot be
    followed, or NONE. `unmet`: why the request is met only approximately, or NONE.
    """

    ratio: float
    impulse_n_s: float
    sets_hold_ratio: bool
    trim: float
    trim_rate_1_s: float
    refusal: Refusal
    unmet: Refusal
