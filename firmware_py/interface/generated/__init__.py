"""What `sources.generate` writes out of `vibro.dbc`: not to be edited."""
