"""What a run leaves: traces, run folder, log, state timelines."""
