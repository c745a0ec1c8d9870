"""The report of a run or a suite as a page, and its templates."""
