"""The paper's diagrams and claims."""
