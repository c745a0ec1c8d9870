"""Processes of a run: children with a pipe, worker processes, and the signals that end them."""
