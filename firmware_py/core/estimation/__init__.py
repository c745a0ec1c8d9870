"""Estimation: crank, striker, impacts, regime, and identification of spring and friction."""
