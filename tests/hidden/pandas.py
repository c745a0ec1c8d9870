"""In place of pandas, in the processes that tests start: see `tests/conftest.py`."""

raise ImportError("pandas is hidden from the processes that tests start")
