"""What the firmware knows: crank, striker, impacts, regime, and the module's identified laws."""
