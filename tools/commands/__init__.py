"""One file a command of `vibrohil`; `tools.cli.program` asks each to register itself."""
