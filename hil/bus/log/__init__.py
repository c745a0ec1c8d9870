"""The frames of a run as text: can.log, written frame by frame or from rows by compiled code."""
