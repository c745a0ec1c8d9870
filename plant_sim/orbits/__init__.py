"""Long motions turn by turn, at a Poincaré section, with bounded memory."""
