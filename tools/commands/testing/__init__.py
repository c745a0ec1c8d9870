"""Commands that test the firmware."""
