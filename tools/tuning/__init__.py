"""Designing and fitting the firmware's parameters."""
