"""The programs that an emulated board needs."""

from lacking import require

from firmware_py.builds import board_tools


def require_board_programs() -> None:
    """Skip where they are missing; on a CI machine that is a failure: no board was tested."""
    require(board_tools.find_missing_tools(), board_tools.REMEDY)
