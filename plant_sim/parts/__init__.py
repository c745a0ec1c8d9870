"""The parts of a scene, one in each file: plain records, for whose types numba compiles."""
