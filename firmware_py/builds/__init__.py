"""How the firmware's one source runs: interpreted, or compiled by numba behind one C function."""
