"""Tools for developers: builds compared, mutation, coverage, precision, reaction times, generated pages."""
