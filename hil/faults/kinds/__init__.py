"""The kinds of faults, one class in one file each."""
