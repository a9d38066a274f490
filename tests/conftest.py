"""Settings of the whole test run."""

import gc
import os

# The matrices are small. A second BLAS thread gains nothing and waits in a loop, on the processor that the other test
# process needs: on two busy cores one test took 100 times as long. NumPy reads this when it is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import tests.pictures  # noqa: F401

# The garbage collector would search two million objects of modules and tests again and again, all of which stay.
gc.disable()


def pytest_collection_finish() -> None:
    """Collect garbage only of what the tests make."""
    gc.freeze()
    gc.enable()
