"""Recorded runs: catalogue, comparison, replay, extracts, the viewer."""
