"""Files that `sources.generate` writes from `vibro.dbc`: not to be edited."""
