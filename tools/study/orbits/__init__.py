"""Long motions at a Poincaré section, period by period, in bounded memory."""
