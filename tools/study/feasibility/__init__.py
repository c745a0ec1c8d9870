"""Which modules can give which pulses."""
