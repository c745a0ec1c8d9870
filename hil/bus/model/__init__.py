"""A CAN bus in integer bit times: arbitration, exact frame lengths, errors and fault confinement."""
