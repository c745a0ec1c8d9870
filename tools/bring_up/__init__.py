"""From an unknown module to a controller that is proven on its simulated twin: one step a file."""
