"""What the blocks read: the parameters, the nominal module, and each block's `Constants` derived from them.

`config_of` makes the configuration before the first tick, `commit` after a commit over the bus. A commit
changes tuning parameters only: the nominal module and the constants of safety keep their bits.
"""

from typing import NamedTuple

from firmware_py.core.control import spin_down
from firmware_py.core.estimation import crank, detector, estimator, striker_model
from firmware_py.core.gait import follow, gait
from firmware_py.core.numbers import in_ticks
from firmware_py.core.safety import consent, drive_link, gate_limits, monitors, own_crank, watchdog_proof
from firmware_py.interface.generated.parameters import Parameters
from firmware_py.interface.zeroed import zeroed

LONGEST_CATCH_UP_S = 0.5
"""Longest time whose missed periods are run later (`node.inbox`). It is longer than the watchdogs of links
and sensors (`ceiling.link_watchdog_s`): raise both together."""


class Config(NamedTuple):
    """`tick_s`: the control period, `p`: the parameters; `nominal`: the module; then each block's constants.

    `parameters_damaged`: the parameters replace values that could not be read, and the firmware must not arm.
    """

    tick_s: float
    catch_up_ticks: int
    p: Parameters
    parameters_damaged: bool
    nominal: striker_model.Nominal
    gate: gate_limits.GateLimits
    own_crank: own_crank.Constants
    monitors: monitors.Constants
    consent: consent.Constants
    drive_link: drive_link.Constants
    proof: watchdog_proof.Constants
    crank: crank.Constants
    estimator: estimator.Constants
    detector: detector.Constants
    gait: gait.Constants


def config_of(parameters: Parameters, damaged: bool) -> Config:
    """The configuration for parameters within their bounds; `damaged`: see `Config`."""
    p, limits = parameters, gate_limits.derive(parameters)
    untuned = zeroed(
        Config,
        tick_s=p.control.tick_s,
        catch_up_ticks=in_ticks(LONGEST_CATCH_UP_S, p.control.tick_s),
        parameters_damaged=damaged,
        nominal=striker_model.derive(p),
        gate=limits,
        own_crank=own_crank.derive(p, limits),
        monitors=monitors.derive(p, limits),
        consent=consent.derive(p, limits),
        drive_link=drive_link.derive(limits),
        proof=watchdog_proof.derive(p, limits),
    )
    return commit(untuned, p)


def commit(config: Config, p: Parameters) -> Config:
    """The configuration with other tuning parameters; damaged ones remain marked as damaged."""
    return config._replace(
        p=p,
        monitors=monitors.retune(config.monitors, p, spin_down.longest_s(p)),
        crank=crank.derive(p),
        estimator=estimator.derive(p),
        detector=detector.derive(p),
        gait=gait.derive(p, config.nominal, config.gate) if follow.is_built_in() else config.gait,
    )
