"""The solvers; `plant_sim.simulation` selects one of them."""
