"""Runs: the job, its nodes in the order of a tick, and the segments that it yields."""
