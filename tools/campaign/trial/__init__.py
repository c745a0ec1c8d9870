"""A trial of a campaign: its sampled truth, its scenario, its run, and its comparison with the truth."""
