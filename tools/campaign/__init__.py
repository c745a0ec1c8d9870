"""Monte Carlo of the closed loop, compiled: firmware, drive, sensors and plant in one kernel."""
