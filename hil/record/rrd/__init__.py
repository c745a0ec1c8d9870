"""The file of the log: whole, repaired, and read only after its messages have been looked at."""
