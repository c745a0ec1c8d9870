"""The firmware or an own controller on the bus."""
