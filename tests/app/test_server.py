"""The server answers only its own page, opens only what the user opened, and leaves nothing behind."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import pytest

import gmwm
from gmwm.applications.app.folders import Folders
from gmwm.applications.app.server import LOADED, open_path, running
from gmwm.applications.app.session import Session
from gmwm.base.errors import MissingDependencyError, OptionError, ReadError
from tests.helpers import raises

pytest.importorskip("dash", reason="needs Dash: pip install '.[app]'")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("opened")
    gmwm.simulate({"gyro_x": "WN(sigma2=1e-6)"}, rate=100.0, samples=1000, rng=1).write(path / "a.csv")
    return path


@pytest.fixture(scope="module")
def served(folder):
    with running(folder / "a.csv") as server:
        yield server


def ask(served, path="", method="GET", body=None, **headers):
    """Status, headers and body of the answer to a request; a header that is None is not sent."""
    url = urlsplit(served.url)
    own = {"Host": url.netloc, "Origin": f"http://{url.netloc}"} | headers
    connection = HTTPConnection(url.hostname, url.port, timeout=100)
    connection.putrequest(method, url.path + path, skip_host=True)
    for name, value in own.items():
        if value is not None:
            connection.putheader(name, value)
    connection.putheader("Content-Length", str(len(body or b"")))
    connection.endheaders(body)
    answer = connection.getresponse()
    return answer.status, answer.headers, answer.read()


def test_the_page_is_served_with_strict_headers(served):
    status, headers, body = ask(served)
    assert status == 200
    assert b"<title>gmwm</title>" in body
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "frame-ancestors 'none'" in policy
    assert "unsafe-eval" not in policy
    script = re.search("script-src ([^;]*)", policy)[1]
    assert "unsafe-inline" not in script
    assert (headers["Referrer-Policy"], headers["Cross-Origin-Resource-Policy"]) == ("no-referrer", "same-origin")


def test_nothing_of_the_page_comes_from_elsewhere(served):
    _, _, body = ask(served)
    assert not re.findall(rb"""(?:src|href)=["'](?:https?:)?//""", body)


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "localhost"},
        {"Host": "evil.example"},
        {"Host": "evil.example:80"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:1"},
    ],
)
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_a_request_with_a_wrong_host_or_origin_is_refused(served, method, headers):
    for path in ("", "_dash-layout", "_dash-update-component", "dropped?name=x.csv"):
        assert ask(served, path, method, b"{}", **headers)[0] == 403


def test_a_request_that_changes_something_needs_an_origin(served):
    assert ask(served, "dropped?name=x.csv", "POST", b"1,2", Origin=None)[0] == 403
    assert ask(served, Origin=None)[0] == 200


def test_a_request_with_a_wrong_token_is_refused(served):
    url = urlsplit(served.url)
    host = {"Host": url.netloc, "Origin": f"http://{url.netloc}"}
    token = url.path.strip("/")
    other = token[:-1] + ("a" if token[-1] != "a" else "b")
    for path in ("/", "/_dash-layout", f"/{other}/", f"/{token}x/", f"/{token[:-1]}/", "//"):
        for method in ("GET", "POST"):
            connection = HTTPConnection(url.hostname, url.port, timeout=100)
            connection.request(method, path, b"{}", host)
            assert connection.getresponse().status == 403, path


def test_files_beside_the_assets_are_not_served(served):
    for path in ("assets/../server.py", "assets/%2e%2e/server.py", "../../etc/passwd", "a.csv"):
        status, _, body = ask(served, path)
        assert status in (403, 404) or b"Dash" in body or b"_dash" in body
        assert b"before_request" not in body
        assert b"root:" not in body


def test_it_listens_on_this_computer_only(served):
    port = urlsplit(served.url).port
    own = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)} - {"127.0.0.1"}
    for address in own - {one for one in own if one.startswith("127.")}:
        with socket.socket() as other:
            other.settimeout(2)
            assert other.connect_ex((address, port)) != 0


def test_a_dropped_file_is_stored_and_removed_at_the_end(folder):
    before = set(threading.enumerate())
    with running(folder) as server:
        status, _, body = ask(server, "dropped?name=..%2Fx.csv", "POST", b"1,2\n" * 1000)
        assert status == 200
        stored = Path(json.loads(body)["path"])
        assert stored.name == "x.csv"
        assert stored.is_relative_to(server.folders.dropped)
        assert stored.read_bytes() == b"1,2\n" * 1000
    assert not stored.parent.exists()
    assert sorted(os.listdir(folder)) == ["a.csv"]
    left = set(threading.enumerate()) - before
    for thread in left:
        thread.join(5)
    assert not any(thread.is_alive() for thread in left)


def test_what_a_path_opens(folder, tmp_path):
    folders, session = open_path(folder / "a.csv", tmp_path)
    assert (folders.root, session.file) == (folder.resolve(), str((folder / "a.csv").resolve()))
    assert open_path(folder, tmp_path) == (Folders(folder.resolve(), tmp_path), Session())
    with raises(OptionError, argument="path"):
        open_path(folder / "none.csv", tmp_path)
    saved = folder / "session.json"
    try:
        saved.write_text(session.with_(units="si").to_text(), encoding="utf-8")
        assert open_path(saved, tmp_path) == (folders, session.with_(units="si"))
        saved.write_text(Session(file="/etc/passwd").to_text(), encoding="utf-8")
        with raises(OptionError, argument="file"):
            open_path(saved, tmp_path)
        saved.write_text("{}", encoding="utf-8")
        with pytest.raises(ReadError):
            open_path(saved, tmp_path)
    finally:
        saved.unlink()


def test_without_the_extra_it_says_what_to_install(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "dash", None)
    with raises(MissingDependencyError, advises=['pip install "gmwm[app]"']), running(folder):
        pytest.fail("it runs")


def test_everything_that_threads_load_is_loaded_before():
    source = Path(gmwm.__file__).parent
    used = {
        name
        for file in source.rglob("*.py")
        for name in re.findall(r"^ +(?:from|import) (scipy\.\w+)", file.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert "scipy.special" in used
    assert used <= set(LOADED)


def test_nothing_else_imports_the_application():
    command = "import sys, gmwm.cli.main; print([name for name in sys.modules if 'dash' in name or '.app.' in name])"
    found = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=True).stdout
    assert found.strip() == "[]"


@pytest.mark.parametrize(
    ("number", "code", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_a_signal_ends_the_command_and_removes_its_folder(folder, tmp_path, number, code, word):
    command = [sys.executable, "-m", "gmwm", "app", str(folder / "a.csv"), "--no-browser"]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment) as app:
        assert app.stdout is not None
        url = urlsplit(app.stdout.readline().strip())
        assert url.hostname == "127.0.0.1"
        assert len(list(Path(tmp_path).glob("gmwm-app-*"))) == 1
        connection = HTTPConnection(url.hostname, url.port, timeout=100)
        connection.request("GET", url.path)
        assert connection.getresponse().status == 200
        app.send_signal(number)
        _, said = app.communicate(timeout=200)
    assert (app.returncode, said) == (code, f"{word}\n")
    assert list(Path(tmp_path).iterdir()) == []
