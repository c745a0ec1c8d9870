"""In place of asammdf, in the processes that tests start: see `tests/conftest.py`."""

raise ImportError("asammdf is hidden from the processes that tests start")
