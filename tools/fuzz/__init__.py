"""Damaged frames, files and folders, and killed processes."""
