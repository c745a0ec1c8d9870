"""The controller of the vibro-impact drive, written as firmware: a pure core in a thin CAN shell."""
