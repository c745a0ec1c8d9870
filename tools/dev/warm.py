"""`python -m tools.dev.warm`: compiles the kernels of nearly every run, and all modules, in advance."""

import compileall
import tempfile
import time
from pathlib import Path

from hil.bench.lockstep import warm_lockstep
from hil.scenario.scenario import load_scenario
from plant_sim.kernels import cache_folder

DEFAULT_SCENARIO = "soft-start-multistable"
ROOT = Path(__file__).parents[2]
PACKAGES = ("plant_sim", "firmware_py", "hil", "tools")


def main() -> None:
    """Compile the kernels, and print the reason for the waiting time first."""
    print(
        f"setup: compiling plant and firmware into {cache_folder().parent}; about a minute, once", flush=True
    )
    started_s = time.perf_counter()
    for package in PACKAGES:  # where PYTHONDONTWRITEBYTECODE is set, each start would compile them again
        compileall.compile_dir(ROOT / package, quiet=2)
    with tempfile.TemporaryDirectory() as folder:
        warm_lockstep(load_scenario(DEFAULT_SCENARIO), "compiled", Path(folder))
    print(f"setup: ready after {time.perf_counter() - started_s:.1f} s", flush=True)


if __name__ == "__main__":
    main()
