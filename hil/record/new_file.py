"""Files within run folders, which may come from somebody else.

A link in a foreign folder may point at any file of this user, and a pipe or a device in it may never end.
"""

import os
import stat
from pathlib import Path

MOST_NOTE_BYTES = 4 << 20
"""Size of the largest JSON or TOML text of a run that is read; in memory it takes up to forty times that."""


def make_anew(path: Path) -> Path:
    """The path of a new, empty file; what stood there is removed, and a link's target is left alone."""
    path.unlink(missing_ok=True)
    os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666))
    return path


def write_anew(path: Path, text: str) -> None:
    """Write a new file; what stood there is removed, and a link's target is left alone."""
    make_anew(path).write_text(text, encoding="utf-8")


def is_regular(path: Path) -> bool:
    """Whether a path is a file itself: no link, folder, pipe or device."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False


def is_foreign(place: Path) -> bool:
    """Whether a file or folder belongs to another user, or is read-only; nothing may be written there."""
    return place.stat().st_uid != os.geteuid() or not os.access(place, os.W_OK)
