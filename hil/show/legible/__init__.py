"""What makes a layout legible: ranges of axes, limits in plots, names of states that are not cut."""
