"""What may never depend on the control law: monitors, supervisor, the drive's axis."""
