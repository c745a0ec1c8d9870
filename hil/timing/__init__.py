"""Clocks, loops, processes and their real-time scheduling."""
