"""The file of the log, and Rerun's program, which mends and shows it."""
