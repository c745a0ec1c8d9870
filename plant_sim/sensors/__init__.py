"""The module's sensors: physics, sampling, errors."""
