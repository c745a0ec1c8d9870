"""What a scenario breaks on purpose: on the bus, at sensors, in drive and module, in processes."""
