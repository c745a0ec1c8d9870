"""Recorded motion for tuning: readings, replay, smoothing, innovations."""
