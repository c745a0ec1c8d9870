"""Runs a command under user-mode Linux, whose kernel has CAN where the machine's has none."""
