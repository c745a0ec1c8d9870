"""The nodes that put each build of the firmware on a bus and the parameters by name."""
