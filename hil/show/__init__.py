"""The views of a run: the Rerun log and its layout, the report, the live view."""
