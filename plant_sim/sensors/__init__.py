"""What the module's sensors see: physics, sampling, errors."""
