"""Branches of periodic impact orbits: followed in one parameter, their special points in two."""
