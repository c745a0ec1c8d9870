"""Files that are written, and files within run folders, which may come from somebody else.

A link in a foreign folder may point at any file of this user, and a pipe or a device in it may never end.
Every file that a command writes is opened here, so that a link is replaced, not followed, whoever puts it
there at whatever moment. A test finds all other ways to open a file.
"""

import os
import stat
from pathlib import Path
from typing import BinaryIO

from compilation.users import own_users

MOST_NOTE_BYTES = 4 << 20
"""Size of the largest JSON or TOML text of a run that is read; in memory it takes up to forty times that."""

SYSTEM = {0, os.stat("/").st_uid}
"""Users whose links lead where this user's own would; in a user namespace root has another number."""


def open_anew(path: Path) -> BinaryIO:
    """A new file, to write bytes; what stood at the path is removed, and a link's target is left alone."""
    path.unlink(missing_ok=True)
    return os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666), "wb")


def append_line(path: Path, line: str) -> None:
    """Add a line to a file, which is made if it is missing. Raises OSError for a link."""
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW
    with os.fdopen(os.open(path, flags, 0o666), "a", encoding="utf-8") as file:
        file.write(f"{line}\n")


def make_anew(path: Path) -> Path:
    """The path of a new, empty file, for a library that opens it by itself."""
    open_anew(path).close()
    return path


def write_anew(path: Path, content: str | bytes) -> None:
    """Write a new file, as `open_anew` makes it."""
    with open_anew(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)


def is_regular(path: Path) -> bool:
    """Whether a path is a file itself: no link, folder, pipe or device."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False


def foreign_link_on(path: Path) -> Path | None:
    """A link on the way to a place that belongs neither to this user nor to the system; None without one."""
    trusted = SYSTEM | own_users()
    for place in (path.absolute(), *path.absolute().parents):
        try:
            found = place.lstat()
        except OSError:  # nothing is there yet, or can be, which its opening says
            continue
        if stat.S_ISLNK(found.st_mode) and found.st_uid not in trusted:
            return place
    return None


def is_foreign(place: Path) -> bool:
    """Whether a file or folder belongs to another user, or is read-only; nothing may be written there."""
    return place.stat().st_uid != os.geteuid() or not os.access(place, os.W_OK)
