"""What holds for all tests."""

import os

# Tests run in as many processes as there are cores: threads of the linear algebra would only wait for each other.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
