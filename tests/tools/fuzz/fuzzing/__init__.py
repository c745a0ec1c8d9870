"""Fuzzing: random frames, damaged files and folders, and killed processes."""
