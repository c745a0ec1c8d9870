"""One solver a file; `plant_sim.simulate` chooses among them."""
