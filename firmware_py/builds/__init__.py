"""The compilers of the firmware's one source: for this machine, for a Cortex-M, in single precision."""
