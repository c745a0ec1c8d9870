"""Safety functions, independent of the control law: monitors, supervisor, the drive's axis."""
