"""The path of a user through the page in Chromium, up to the same file from the command that the page shows."""

import shlex
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from urllib.parse import urlsplit

import pytest

import gmwm
from gmwm.applications.app.server import running
from gmwm.applications.app.session import Session
from gmwm.theory.simulation import reference_imu

pytest.importorskip("dash", reason="needs Dash: pip install '.[app]'")

pytestmark = [pytest.mark.browser, pytest.mark.slow]

SHARED = Path(__file__).parents[3] / "shared" / "data" / "adis16405_static_1_first_1000s.csv"
TABS = ("recording", "curves", "model", "numbers", "download")
WAIT = 60_000
"""Longest time (ms) for a calibration on a busy machine."""


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
    place |= {"numbers": "#numbers .filter", "download": "#preview pre"}
    page.locator(place[name]).first.wait_for()
    if name == "model":
        page.wait_for_function("document.querySelector('#model').value !== ''")


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
    # The recommended model has values from the spectrum, whose fields decide nothing when they appear.
    page.locator("#fit input").first.wait_for()
    page.locator("#status.idle").wait_for(state="attached")
    assert "that gmwm recommends" in page.locator("#fit h2").text_content()
    page.fill("#model", "2*GM + WN + RW")
    page.press("#model", "Enter")
    page.locator("#fit h2", has_text="your model").wait_for()
    page.locator("#terms .chip", has_text="GM[2]").wait_for()
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
        assert f'--model "{axis}=2*GM + WN + RW"' in page.locator("#shell pre").text_content()
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
    for _ in range(100):  # the plot can be seen before it takes the mouse
        page.mouse.move(box["x"] + 0.25 * box["width"], y)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.5 * box["width"], y, steps=5)
        page.mouse.up()
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


def test_two_pages_do_not_disturb_each_other_and_work_is_cancelled(opened, folder, monkeypatch):
    go = threading.Event()
    calibrate = gmwm.calibrate

    def slow(*given, progress, **more):
        for k in range(1200):
            progress(k, 1200, "waiting")
            if go.wait(0.05):
                break
        return calibrate(*given, progress=progress, **more)

    monkeypatch.setattr(gmwm, "calibrate", slow)
    first = opened(folder / "short.csv")
    second = opened(None, served=first.served)
    for page in (first, second):
        tab(page, "recording")
    skip_span(first, "10s", "20s")
    assert second.locator("#spans button").count() == 0
    for page in (first, second):
        page.click("#tab-numbers")
        page.locator("#doing", has_text="waiting").wait_for()
    first.click("#cancel")
    first.locator("#numbers", has_text="Calibrating was cancelled.").wait_for()
    first.locator("#status.idle").wait_for(state="attached")
    assert "waiting" in second.locator("#doing").text_content()
    go.set()
    second.locator("#numbers .filter").first.wait_for()
    first.get_by_role("button", name="Start again").first.click()
    first.locator("#numbers .filter").first.wait_for()
    for page in (first, second):
        tab(page, "download")
    assert "--skip 10-20" in first.locator("#shell pre").text_content()
    assert "--skip" not in second.locator("#shell pre").text_content()
    assert first.said == second.said == []


def test_errors_are_beside_what_they_concern(opened, folder):
    page = opened(folder)

    for path, text in {
        "../outside.csv": "outside the folder",
        "none.csv": "does not exist",
        "damaged.csv": "line 501",
    }.items():
        page.fill("#path", path)
        page.click("#open")
        page.locator("#error-file", has_text=text).wait_for()
    assert page.locator("#traces .js-plotly-plot").count() == 0
    page.fill("#path", "short.csv")
    page.press("#path", "Enter")
    tab(page, "recording")
    assert page.locator("#error-file").text_content() == ""
    page.click("#reading summary")
    page.fill("#rate", "fast")
    page.press("#rate", "Enter")
    page.locator("#error-rate", has_text="a number").wait_for()
    page.fill("#rate", "")
    page.press("#rate", "Enter")
    page.fill("#span-from", "20s")
    page.fill("#span-to", "10s")
    page.click("#skip")
    page.locator("#error-skip:not(:empty), #error-stop:not(:empty)").first.wait_for()
    page.click("#tab-model")
    page.locator("#fit h2").wait_for()
    page.fill("#model", "WN + VN")
    page.press("#model", "Enter")
    page.locator("#error-model", has_text="VN").wait_for()
    page.fill("#model", "WN + RW")
    page.press("#model", "Enter")
    page.locator("#fit h2", has_text="your model").wait_for()
    assert page.locator("#error-model").text_content() == ""


def test_a_term_is_held_by_dragging_and_by_a_button(opened, folder):
    page = opened(folder / "short.csv")
    tab(page, "model")
    page.fill("#model", "WN + RW")
    page.press("#model", "Enter")
    page.locator("#fit h2", has_text="your model").wait_for()
    page.locator("#fit .shapelayer path").first.wait_for()
    page.get_by_role("button", name="Fix", exact=True).first.click()
    page.get_by_role("button", name="Free", exact=True).wait_for()
    assert "WN(sigma2=fixed(" in page.input_value("#model")
    page.get_by_role("button", name="Free", exact=True).click()
    page.get_by_role("button", name="Free", exact=True).wait_for(state="detached")
    page.wait_for_timeout(500)
    page.locator("#status.idle").wait_for(state="attached")
    page.evaluate("window.scrollTo(0, 0)")
    box = page.locator("#fit .shapelayer path").first.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - 40, steps=4)
    page.mouse.up()
    page.get_by_role("button", name="Free", exact=True).first.wait_for()
    held = gmwm.Model.parse(page.input_value("#model"))
    assert len(held.fixed_names) == 1
    (name,) = held.fixed_names
    truth = {"WN.sigma2": 4e-7, "RW.gamma2": 2e-11}[name]
    assert held.parameters[name] > 1.5 * truth
    assert page.said == []


def test_it_works_by_keyboard_and_a_session_comes_back(opened, folder):
    page = opened(folder / "short.csv")
    tab(page, "recording")
    page.focus("#tab-recording")
    page.keyboard.press("ArrowLeft")
    page.locator("#panel-download").wait_for()
    page.keyboard.press("Home")
    page.locator("#panel-recording").wait_for()
    page.keyboard.press("ArrowRight")
    page.locator("#panel-curves").wait_for()
    assert page.evaluate("document.activeElement.id") == "tab-curves"
    page.locator("#curves .js-plotly-plot").first.wait_for()
    page.focus("#view input")
    page.keyboard.press("ArrowRight")
    page.locator("#curves .ytitle", has_text="Wavelet variance").first.wait_for()
    page.click("#tab-download")
    session, _ = downloaded(page, "#get-session")
    assert Session.from_text(session.decode()).view == "wavelet"
    (folder / "session.json").write_bytes(session)
    again = opened(folder / "session.json")
    tab(again, "curves")
    assert again.locator("#curves .ytitle").first.text_content() == "Wavelet variance (deg²/h²)"
    assert again.locator("#view input").nth(1).is_checked()


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_every_tab_fits_its_width_and_prints(opened, folder, width, scheme):
    page = opened(folder / "short.csv", width, scheme)
    for name in TABS:
        tab(page, name)
        page.locator("#status.idle").wait_for(state="attached")
        assert page.evaluate("document.documentElement.scrollWidth") <= width, name
        svgs = "[...document.querySelectorAll('section:not([hidden]) .main-svg')]"
        rights = page.evaluate(f"{svgs}.map(svg => svg.getBoundingClientRect().right)")
        assert max(rights, default=0) <= width, name
    page.emulate_media(media="print")
    assert not page.locator("nav").is_visible()
    assert page.locator("#preview pre").is_visible()
    assert page.evaluate("getComputedStyle(document.querySelector('#preview pre')).maxHeight") == "none"
    assert page.said == []


def test_groups_have_names_and_options_are_no_controls(opened, folder):
    page = opened(folder / "short.csv")
    tab(page, "curves")
    assert page.get_by_role("radiogroup", name="View").count() == 1
    assert page.locator("[role=option] input, [role=listbox]:not([aria-label]):not([aria-labelledby])").count() == 0
    tab(page, "numbers")
    assert page.get_by_role("slider", name="Horizon").count() == 1
    assert page.locator("#numbers details:not([open])").count() >= 1
    assert page.evaluate("document.activeElement.className").find("focus-target") < 0
