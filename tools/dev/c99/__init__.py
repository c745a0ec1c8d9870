"""Checks of the emitted C by compilers, checkers and sanitizers."""
