"""`python -m tools.dev.lowest`: the default scenario with the oldest version of each package that is allowed.

It makes an environment in a temporary folder, installs the lower bound of every dependency of pyproject.toml
(and whatever versions pip chooses of their own dependencies), and runs the scenario there in lockstep. The
exit status is that of pip or of the run; the versions are printed. It downloads 1.3 GB.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
SCENARIO = "soft-start-multistable"
BOUND = re.compile(r"([\w.-]+)(\[[\w,]+\])?>=([\w.]+)")


def lowest() -> list[str]:
    """Every dependency at its lower bound, as a requirement of pip."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    bounds = [BOUND.fullmatch(one) for one in project["dependencies"]]
    assert all(bounds), "each dependency needs a lower bound, and nothing else"
    return [f"{bound[1]}=={bound[3]}" for bound in bounds if bound]


def main() -> int:
    """Install and run; return the exit status."""
    argparse.ArgumentParser(prog="python -m tools.dev.lowest", description=__doc__).parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        python = folder / "venv" / "bin" / "python"
        subprocess.run([sys.executable, "-P", "-m", "venv", str(folder / "venv")], check=True)
        pip = [str(python), "-P", "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
        for arguments in (lowest(), ["--no-deps", str(ROOT)]):
            installed = subprocess.run([*pip, *arguments], check=False)
            if installed.returncode != 0:
                return installed.returncode
        print("\n".join(lowest()))
        command = [str(python.with_name("vibrohil")), "run", SCENARIO, "--clock", "lockstep"]
        environment = os.environ | {"VIBROHIL_CACHE_DIR": str(folder / "kernels")}
        return subprocess.run(command, cwd=folder, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
