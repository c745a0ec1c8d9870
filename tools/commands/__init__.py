"""The commands of `vibrohil`, one file each; `tools.program.program` calls the `register` of each file."""
