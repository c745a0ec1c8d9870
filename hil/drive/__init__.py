"""The simulated motor drive as pure steps: its axis, commands and reports."""
