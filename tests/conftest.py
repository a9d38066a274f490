"""Settings of the whole test run."""

import gc
import os
import shutil
from collections.abc import Iterator
from typing import Any

import pytest

# The matrices are small. A second BLAS thread gains nothing and waits in a loop, on the processor that the other test
# process needs: on two busy cores one test took 100 times as long. NumPy reads this when it is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import tests.pictures  # noqa: F401
from tests.forked import Forks

# The garbage collector would search two million objects of modules and tests again and again, all of which stay.
gc.disable()


def pytest_collection_finish() -> None:
    """Collect garbage only of what the tests make."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def forks() -> Iterator[Forks]:
    """A process that has imported the package, and forks for each page and each command of the tests."""
    forks = Forks.new()
    yield forks
    forks.close()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium, driven by Playwright. Without one of them the test is skipped."""
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
    if chromium is None:
        pytest.skip("needs Chromium on the path: apt install chromium")
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Playwright: pip install '.[browser]'")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield browser
        browser.close()
