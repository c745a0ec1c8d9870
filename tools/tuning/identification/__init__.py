"""Identification of the module's parameters and friction law from a minute of motion."""
