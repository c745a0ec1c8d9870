"""What the firmware asks of the motor: starting, holding, following a gait, stopping."""
