"""Taylor series and DOP853 over the hybrid automaton of every part, with dense output and located events."""
