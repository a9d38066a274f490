"""Ratios of our times to those of something everyone has: `python -m benchmarks` from the root of the project."""

import os

# One thread on both sides. Set before NumPy is imported: on a busy machine the threads of a BLAS wait for each other,
# and a dot product takes ten times its time.
for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ[_name] = "1"
