"""The module's laws from a minute of motion."""
