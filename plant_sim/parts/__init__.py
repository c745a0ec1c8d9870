"""The parts a scene composes, one concept a file: plain records that numba compiles by their type."""
