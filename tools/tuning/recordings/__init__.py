"""Recorded motion as tuning reads it: readings, replay, smoothing, innovations."""
