"""The path of a user through the page in Chromium, up to the same file from the command that the page shows."""

import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlsplit

import pytest

import gmwm
from gmwm.app.server import running
from gmwm.app.session import Session
from gmwm.simulation import reference_imu

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
if CHROMIUM is None:
    pytest.skip("needs Chromium on the path: apt install chromium", allow_module_level=True)
pytest.importorskip("dash", reason="needs Dash: pip install '.[app]'")
playwright = pytest.importorskip("playwright.sync_api", reason="needs Playwright: pip install '.[browser]'")

pytestmark = [pytest.mark.browser, pytest.mark.slow]

SHARED = Path(__file__).parents[3] / "shared" / "data" / "adis16405_static_1_first_1000s.csv"
TABS = ("recording", "curves", "model", "numbers", "download")
WAIT = 90_000
"""Longest time (ms) for a calibration on a busy machine."""


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with two recordings, a damaged file, and a recording outside of it."""
    path = tmp_path_factory.mktemp("recordings") / "opened"
    path.mkdir()
    truth = {"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=2e-11)", "accel_x": "WN(sigma2=2e-5) + RW(gamma2=1e-9)"}
    imu = gmwm.simulate(truth, rate=100.0, samples=30_000, rng=4)
    imu.write(path / "short.csv")
    imu["gyro"].write(path.parent / "outside.csv")
    imu["gyro"].write(path / "gyro.csv")
    whole = (path / "short.csv").read_text(encoding="utf-8").splitlines()
    (path / "damaged.csv").write_text("\n".join([*whole[:500], "1,2,damaged", *whole[500:900]]), encoding="utf-8")
    return path


@pytest.fixture
def opened(browser):
    """A function: a page of a file or folder at a width, with what it asked for and complained of."""
    closing = []

    def open_page(path, width=1280, scheme="light", served=None):
        if served is None:
            server = running(path)
            served = server.__enter__()
            closing.append(lambda: server.__exit__(None, None, None))
        context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
        closing.append(context.close)
        page = context.new_page()
        page.set_default_timeout(WAIT)
        page.asked, page.said, page.served = [], [], served
        page.on("request", lambda request: page.asked.append(request.url))
        page.on("console", lambda message: page.said.append(message.text))
        page.on("pageerror", lambda error: page.said.append(str(error)))
        page.goto(served.url)
        return page

    yield open_page
    for close in reversed(closing):
        close()


def tab(page, name):
    """Show a tab, and wait until nothing of it is missing."""
    page.click(f"#tab-{name}")
    if name == "recording":
        page.locator("#verdict .facts").wait_for()
    place = {
        "recording": "#traces .js-plotly-plot",
        "curves": "#curves .js-plotly-plot",
        "model": "#fit .js-plotly-plot",
    }
    place |= {"numbers": "#numbers .datasheet", "download": "#preview pre"}
    page.locator(place[name]).first.wait_for()


def choose(page, menu, option):
    page.click(menu)
    page.get_by_role("option", name=option, exact=True).click()


def downloaded(page, button):
    with page.expect_download() as waiting:
        page.click(button)
    return Path(waiting.value.path()).read_bytes(), waiting.value.suggested_filename


def skip_span(page, begin, end):
    page.fill("#span-from", begin)
    page.fill("#span-to", end)
    page.click("#skip")
    page.locator("#spans button").first.wait_for()


def repeated(page, folder):
    """The file that the shown commands write, run in a shell."""
    lines = page.locator("#shell pre").text_content().splitlines()
    for line in lines:
        words = shlex.split(line)
        assert words[0] == "gmwm"
        subprocess.run([sys.executable, "-m", "gmwm", *words[1:]], cwd=folder, check=True, capture_output=True)
    return (folder / "imu.yaml").read_bytes()


def test_a_user_calibrates_the_shared_recording_and_repeats_it_in_a_shell(opened, tmp_path):
    if not SHARED.exists():
        pytest.skip("the shared recording is not at hand")
    shutil.copy(SHARED, tmp_path / "static.csv")
    page = opened(tmp_path)
    page.click("#browse summary")
    page.get_by_role("button", name="static.csv").click()
    page.locator("#error-units", has_text="--units gyro=deg/s").wait_for()
    choose(page, "#gyro", "deg/s")
    tab(page, "recording")
    assert page.locator("#error-units").text_content() == ""
    assert "100000 samples at 100 Hz" in page.locator("#verdict").text_content()
    skip_span(page, "100s", "2min")
    tab(page, "curves")
    tab(page, "model")
    page.fill("#model", "2*GM + WN + RW")
    page.press("#model", "Enter")
    page.locator("#fit h2", has_text="your model").wait_for()
    assert page.locator("#terms .chip").all_text_contents() == ["GM[1] ×", "GM[2] ×", "WN ×", "RW ×"]
    page.click("#spread")
    page.get_by_role("button", name="Accelerometer X").click()
    page.locator("#fit h2", has_text="Accelerometer X").wait_for()
    page.locator("#ranking button").first.click()
    page.locator("#fit h2", has_text="Accelerometer X: your model").wait_for()
    page.click("#spread")
    tab(page, "numbers")
    tab(page, "download")
    found, name = downloaded(page, "#download")
    assert name == "imu.yaml"
    assert "--skip 100-120" in page.locator("#shell pre").text_content()
    for axis in ("gyro_x", "gyro_y", "gyro_z"):
        assert f"--model '{axis}=2*GM + WN + RW'" in page.locator("#shell pre").text_content()
    assert repeated(page, tmp_path) == found
    session, _ = downloaded(page, "#get-session")
    assert Session.from_text(session.decode()).reading == {"units": {"gyro": "deg/s"}, "skip": [[100.0, 120.0]]}
    assert page.said == []
    host = urlsplit(page.served.url).netloc
    assert {urlsplit(url).netloc for url in page.asked if not url.startswith(("blob:", "data:"))} == {host}


def test_a_million_samples_open_and_a_span_is_marked_with_the_mouse(opened, tmp_path):
    imu = gmwm.simulate(reference_imu(), rate=200.0, samples=1_000_000, rng=1)
    imu.write(tmp_path / "long.parquet")
    page = opened(tmp_path / "long.parquet")
    tab(page, "recording")
    assert page.locator("#traces .js-plotly-plot").count() == 6
    box = page.locator("#traces .nsewdrag").first.bounding_box()
    y = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 0.25 * box["width"], y)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.5 * box["width"], y, steps=5)
    page.mouse.up()
    for _ in range(100):
        begin, end = (page.input_value(f"#span-{name}") for name in ("from", "to"))
        if end:
            break
        page.wait_for_timeout(50)
    # The axis has a margin of 1 % on both sides.
    first, last = (float(text.removesuffix("s")) for text in (begin, end))
    assert first == pytest.approx(0.25 * 5000, abs=60)
    assert last == pytest.approx(0.5 * 5000, abs=60)
    page.click("#skip")
    page.locator("#spans button").wait_for()
    page.locator("#verdict", has_text="2 segments").wait_for()
    tab(page, "curves")
    page.locator("#spans button").first.evaluate("button => button.click()")
    assert page.said == []
