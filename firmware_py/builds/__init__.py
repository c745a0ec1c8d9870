"""The builds of the firmware's one source: interpreted, or compiled by numba behind one C function."""
