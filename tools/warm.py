"""`python -m tools.warm`: compiles the plant's kernels for the default scene, so that no run has to wait."""

import time

from plant_sim.kernels import cache_folder
from plant_sim.plant import warm
from plant_sim.scene import load_scene

DEFAULT_SCENE = "table1-motor-soft"


def main() -> None:
    """Compile, and say meanwhile why it takes a while."""
    print(f"setup: compiling the plant's kernels into {cache_folder()}; half a minute, once", flush=True)
    started_s = time.perf_counter()
    warm(load_scene(DEFAULT_SCENE))
    print(f"setup: kernels ready after {time.perf_counter() - started_s:.1f} s", flush=True)


if __name__ == "__main__":
    main()
