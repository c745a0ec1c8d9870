"""The bench: buses, clocks and loops, the plant's CAN node, scenarios, checks, traces, recorder, report."""
