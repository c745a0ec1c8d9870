"""The figures of a run, computed from its traces alone: the record of each, its unit and its meaning."""
