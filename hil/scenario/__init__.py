"""What a scenario says: tables, settings, script of the operator, faults, seeds."""
