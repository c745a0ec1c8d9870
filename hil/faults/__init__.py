"""The faults of a scenario: on the bus, at sensors, in drive and module, in processes."""
