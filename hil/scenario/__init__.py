"""Scenarios: tables, settings, script of the operator, faults, seeds."""
