"""Studies: the paper's diagrams and claims, feasibility for a walk, and ways to give one pulse a stride."""
