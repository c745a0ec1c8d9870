"""The users whose files are trusted as this user's own."""

import os


def own_users() -> set[int]:
    """User ids that are this user: under user-mode Linux files keep the outer user's, see `hil.kernel`."""
    outer = os.environ.get("VIBROHIL_OUTER_USER")
    return {os.geteuid()} | ({int(outer)} if outer else set())
