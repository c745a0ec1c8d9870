"""The commands of `vibrohil`, one file each; `tools.cli.program` calls the `register` of each file."""
