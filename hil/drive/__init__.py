"""The simulated drive of the motor: its axis, its commands, its reports; pure steps."""
