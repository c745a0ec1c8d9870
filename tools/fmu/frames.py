"""CAN frames as variables of an FMU: a count, and four 32-bit integers a frame."""

from tools.fmu.variables import Role, Variable

MOST_RECEIVED = 8
"""Frames to a node in one step; no node of the bench receives more in a tick."""
LOW, HIGH = -(2.0**31), 2.0**31 - 1.0


def frame_places(variables: list[Variable]) -> str:
    """Where frames are among the variables, for `model.h`."""
    names = [one.name for one in variables]
    received, sent = names.index("received.count"), names.index("sent.count")
    most_sent = sum(one.startswith("sent[") and one.endswith(".id") for one in names)
    places = f"RECEIVED = {received}, MOST_RECEIVED = {MOST_RECEIVED}, SENT = {sent}, MOST_SENT = {most_sent}"
    return f"enum {{ {places} }};"


def frame_variables(direction: str, role: Role, most: int) -> list[Variable]:
    """The variables of the frames that arrive in a step (`received`) or leave in it (`sent`)."""
    variables = [
        Variable(f"{direction}.count", role, f"number of frames {direction}", 0.0, 0.0, most, is_integer=True)
    ]
    for place in range(most):
        name = f"{direction}[{place}]"
        variables += [
            Variable(f"{name}.id", role, "11-bit identifier", 0.0, 0.0, 2047.0, is_integer=True),
            Variable(f"{name}.length", role, "number of bytes", 0.0, 0.0, 8.0, is_integer=True),
            Variable(f"{name}.low", role, "bytes 0 to 3, the first lowest", 0.0, LOW, HIGH, is_integer=True),
            Variable(f"{name}.high", role, "bytes 4 to 7, the first lowest", 0.0, LOW, HIGH, is_integer=True),
        ]
    return variables
