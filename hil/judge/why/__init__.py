"""Why a run ended as it did: the limits of latched faults, and failed checks."""
