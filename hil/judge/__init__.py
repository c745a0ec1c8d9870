"""The judgement of a run: figures, checks, requirements, JUnit."""
