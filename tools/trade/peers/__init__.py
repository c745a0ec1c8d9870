"""Methods other than the plant's own, for comparison: heyoka, scipy and time stepping."""
