"""Commands that put one node on a bus."""
