"""A picture for each tuning command."""
