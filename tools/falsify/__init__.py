"""Searches for the run with the smallest margin: falsification of the requirements."""
