"""What surrounds the core: frames to inputs, outputs to frames, the parameter table."""
