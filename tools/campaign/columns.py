"""Where things stand in the arrays of a run."""

DETECTIONS, PERIODS, MODES, TURNS_SEEN, KICKED, FULL = range(6)
"""Places of Record.counts: rows filled, and whether a buffer ran out."""

(
    TRACE_X,
    TRACE_V,
    TRACE_OMEGA,
    TRACE_ANGLE,
    TRACE_X_ESTIMATED,
    TRACE_V_ESTIMATED,
    TRACE_MODE,
    TRACE_IMPACT,
    TRACE_TORQUE,
    TRACE_REGIME,
    TRACE_TARGET,
    TRACE_LOW,
    TRACE_HIGH,
    TRACE_HOUSING,
    TRACE_POSITION,
    TRACE_VELOCITY,
    TRACE_FELT,
    TRACE_PHASE,
    TRACE_CONFIDENCE,
    TRACE_COLUMNS,
) = range(20)
"""Columns of Record.trace, a row a tick: the truth at t_k, what the firmware made of it, and the frames' own
readings (m/s², revolutions, revolutions by second), which are all that a log of the
bus has; then the force on a wearer, N, and where in the gait cycle the firmware takes the wearer to be."""

(
    SUM_TICKS,
    SUM_X,
    SUM_V,
    SUM_OMEGA,
    SUM_OMEGA_2,
    WORST_X,
    WORST_V,
    SUM_NIS,
    LEAST_EIGENVALUE,
    LEAST_AT,
    REFUSED_AT,
    SUMS,
) = range(12)
"""Places of Record.sums, over the ticks of mode RUN from a given tick on; of an endless run also the
smallest eigenvalue of the estimate's covariance, and in which tick; the tick in which a ratio was first
refused as too high."""
