"""The shell around the core: nodes of each build, parameters by name, and the table of faults."""
