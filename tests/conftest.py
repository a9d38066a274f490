"""Settings of the whole test run."""

import os

# The matrices are small. A second BLAS thread gains nothing and waits in a loop, on the processor that the other test
# process needs: on two busy cores one test took 100 times as long. NumPy reads this when it is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import tests.pictures  # noqa: F401
