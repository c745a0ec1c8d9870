"""One solver a file; `plant_sim.simulation` chooses among them."""
