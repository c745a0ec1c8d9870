"""What a run is worth: figures, checks, requirements, JUnit."""
