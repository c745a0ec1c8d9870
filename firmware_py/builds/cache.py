"""The folder of machine code compiled from the firmware.

numba's cache notices an edited function but neither an edited callee nor a reordered record, so the folder is
named by a hash of every source file of the firmware.
"""

import hashlib
import os
from pathlib import Path


def source_hash() -> str:
    """A hash of all Python sources of the firmware, names included."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for source in sorted(package.rglob("*.py")):
        digest.update(str(source.relative_to(package)).encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """$VIBROHIL_CACHE_DIR/firmware-HASH, else vibrohil/firmware-HASH under the user's cache folder."""
    chosen = os.environ.get("VIBROHIL_CACHE_DIR")
    if chosen:
        return Path(chosen) / f"firmware-{source_hash()}"
    user_cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return user_cache / "vibrohil" / f"firmware-{source_hash()}"
