"""Photograph the tabs of `gmwm app` in Chromium, with the extras `app` and `browser`: `python -m docs.pictures.app`."""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from gmwm.simulation import reference_imu, simulate

from docs.pictures.__main__ import LARGEST, moved
from gmwm.applications.app.server import running

SIZE = {"width": 1100, "height": 760}
READY = {
    "recording": "#traces .js-plotly-plot",
    "curves": "#spectra .js-plotly-plot",
    "model": "#ranking table",
    "numbers": "#budget .js-plotly-plot",
    "download": "#preview pre",
}
"""What a tab shows last."""
WAIT = 100_000
"""Longest time (ms) of a calibration."""


def main() -> int:
    """Draw the five pictures; return 1 if one of them is too large."""
    from playwright.sync_api import sync_playwright

    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))))
    made = []
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        recording = Path(folder, "static.csv")
        simulate(reference_imu(), rate=100.0, duration=1200.0, rng=1).write(recording)
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        with running(recording) as served:
            page = browser.new_page(viewport=SIZE)
            page.set_default_timeout(WAIT)
            page.goto(served.url)
            for name, last in READY.items():
                page.click(f"#tab-{name}")
                page.locator(last).first.wait_for()
                page.locator("#status.idle").wait_for(state="attached")
                if name == "recording":
                    page.locator("#verdict .facts").wait_for()
                    # The folder of this recording is not the reader's.
                    page.evaluate("() => { document.getElementById('path').value = 'static.csv'; }")
                page.wait_for_timeout(500)
                picture = Path(folder, f"app-{name}.png")
                page.screenshot(path=picture)
                made.append(moved(picture))
        browser.close()
    large = [file.name for file in made if file.stat().st_size > LARGEST]
    print(*made, *(f"{name} is larger than {LARGEST} bytes" for name in large), sep="\n")
    return 1 if large else 0


if __name__ == "__main__":
    sys.exit(main())
