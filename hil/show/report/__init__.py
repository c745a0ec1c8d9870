"""The report of a run or a suite as a page: its plots, its templates."""
