"""One thread for linear algebra: on matrices as small as the bench's, more only wait for each other.

On two busy cores, OpenBLAS solves for a triangle of 100 rows in 20 µs with one thread, in 8 ms with two.
"""

import os

ONE_THREAD_EACH = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""As it has to stand in the environment when numpy is imported."""


def keep_to_one_thread() -> None:
    """For this process and those that it starts, but for what the user's environment says already."""
    for name, count in ONE_THREAD_EACH.items():
        os.environ.setdefault(name, count)
