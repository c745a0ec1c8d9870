"""What was new in a run between two moments."""

import dataclasses

import numpy as np

from hil.record.candump import bus_log
from hil.record.run_traces import RunTraces, column


def part(traces: RunTraces, start_s: float, end_s: float) -> RunTraces:
    """What was new between two moments of a run."""

    def cut(records):
        t_s = column(records, "t_s")
        return records[(t_s >= start_s) & (t_s < end_s)]

    bus = traces.bus.whole()
    rows = np.flatnonzero((bus.t_s >= start_s) & (bus.t_s < end_s))
    return dataclasses.replace(
        traces,
        plant=cut(traces.plant),
        firmware=cut(traces.firmware),
        impacts=cut(traces.impacts),
        operator=cut(traces.operator),
        bus=bus_log(bus.t_s[rows], bus.can_id[rows], bus.payloads_of(rows)),
    )
