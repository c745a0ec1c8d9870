"""Logs for and of other programs: export and import."""
