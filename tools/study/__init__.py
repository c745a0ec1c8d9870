"""Studies: the paper's diagrams and claims and feasibility for a walk."""
