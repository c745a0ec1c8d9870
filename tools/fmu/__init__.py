"""Functional Mock-up Units: the plant and the firmware as machine code for other simulation programs."""
