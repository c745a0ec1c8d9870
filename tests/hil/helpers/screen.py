"""What the Rerun viewer needs for a window that nobody sees."""

import ctypes.util
import shutil
from pathlib import Path

from lacking import require

DRIVERS = Path("/usr/share/vulkan/icd.d")


def require_screen() -> None:
    """Skip the test where a virtual screen, a driver or a library of the window is missing."""
    found = {
        "xvfb": shutil.which("Xvfb") and shutil.which("xvfb-run"),
        "mesa-vulkan-drivers": DRIVERS.is_dir() and any(DRIVERS.iterdir()),
        "libxkbcommon-x11-0": ctypes.util.find_library("xkbcommon-x11"),
        "libxcursor1": ctypes.util.find_library("Xcursor"),
        "libxi6": ctypes.util.find_library("Xi"),
    }
    missing = [package for package, is_there in found.items() if not is_there]
    require(missing, f"apt-get install {' '.join(missing)}")
