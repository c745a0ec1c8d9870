"""The tables of a scene's file: their keys, and the bounds of each."""
