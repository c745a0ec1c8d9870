"""The operator on the bus: a script's commands as frames."""
