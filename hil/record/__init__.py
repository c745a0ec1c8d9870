"""The record of a run: traces, run folder, log, state timelines."""
