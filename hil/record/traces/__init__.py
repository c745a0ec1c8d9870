"""Traces: each process's signals at each of its ticks as fixed records, written and read."""
