"""Estimation: crank, striker, impacts and regime."""
