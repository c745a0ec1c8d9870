"""`python -m tools.warm`: compiles the default scenario's kernels before anything has to wait for them."""

import time

from hil.scenario import load_scenario
from hil.warm import warm_plant
from plant_sim.kernels import cache_folder

DEFAULT_SCENARIO = "soft-start-multistable"


def main() -> None:
    """Compile, and say meanwhile why it takes a while."""
    print(f"setup: compiling the plant's kernels into {cache_folder()}; half a minute, once", flush=True)
    started_s = time.perf_counter()
    warm_plant(load_scenario(DEFAULT_SCENARIO).scene)
    print(f"setup: kernels ready after {time.perf_counter() - started_s:.1f} s", flush=True)


if __name__ == "__main__":
    main()
