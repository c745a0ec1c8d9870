"""Runs and logs: catalogue, comparison, import, export, the viewer."""
