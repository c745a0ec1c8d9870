"""Runs: options, job, nodes in the order of a tick, segments; real time; the verdict; a recorded run."""
