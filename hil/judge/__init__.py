"""The judgement of a run: its checks evaluated on its figures, verdict, JUnit."""
