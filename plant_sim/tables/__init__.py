"""The tables of a scene file: their keys and the bounds of the values."""
