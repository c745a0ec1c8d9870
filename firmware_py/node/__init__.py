"""The firmware as one pure function of frames: receiving, the control blocks, transmitting."""
