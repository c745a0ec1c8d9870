"""One trial of a campaign: sampled, made a scenario, run, and judged against the truth."""
