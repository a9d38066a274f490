"""The site, built once as strictly as `make docs` builds it."""

import fcntl
import os
import subprocess
import sys

import pytest

from tests.docs.pages import DOCS


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """The folder of the built site, which all processes of a run share; a warning of Sphinx is a failure."""
    shared = tmp_path_factory.getbasetemp()
    folder = (shared.parent if os.environ.get("PYTEST_XDIST_WORKER") else shared) / "site"
    folder.mkdir(exist_ok=True)
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "errors").exists():
            options = ["-W", "--keep-going", "-q", "-b", "html", "-d", str(folder / "doctrees")]
            options += ["-D", "toc_object_entries=0"]  # their copies for each page take a fifth of the time
            command = [sys.executable, "-m", "tests.docs.build", *options, str(DOCS), str(folder / "html")]
            done = subprocess.run(command, cwd=DOCS.parent, capture_output=True, encoding="utf-8")
            (folder / "errors").write_text(done.stderr or "failed" if done.returncode else "", encoding="utf-8")
    assert (folder / "errors").read_text(encoding="utf-8")[-5000:] == ""
    return folder / "html"
