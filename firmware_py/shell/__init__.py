"""The nodes that put each build of the firmware on a bus, parameters by name, and the table of faults."""
