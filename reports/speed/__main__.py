"""`python -m reports.speed`: one core for all that runs in this process, before anything loads a BLAS with threads."""

import os

from reports.speed import BLAS_THREADS


def main() -> None:
    """Set the number of threads, and measure."""
    os.environ[BLAS_THREADS] = "1"
    from reports.speed import bench

    bench.main()


if __name__ == "__main__":
    main()
