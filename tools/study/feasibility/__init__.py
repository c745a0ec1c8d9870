"""Feasibility of modules for a walk: the table of suitable settings, its chart and its page."""
