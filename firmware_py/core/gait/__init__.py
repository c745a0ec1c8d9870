"""Following the gait, above the other controllers: the cycle, the lock of the crank, the turns per stride."""
