"""The commands of `vibrohil`, one file each with a function or a group of that name (see tools.program)."""
