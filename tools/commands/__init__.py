"""One file a command of `vibrohil`; each registers itself on `tools.cli.app`."""
