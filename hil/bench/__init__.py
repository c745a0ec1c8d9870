"""The bench itself: runs in lockstep and in real time, suites, verdicts, comparisons."""
