"""Additions to numba that plant and firmware share: a cache on disk, linking, and `_replace` of records."""

PACKAGES = ("compilation", "plant_sim", "firmware_py", "hil", "tools")
"""The project's packages: kernels and results depend on their sources."""
