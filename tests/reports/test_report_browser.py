"""The page in a browser: it draws, answers to the pointer, copies, prints, fits a phone, and asks no network."""

import pytest

import gmwm

pytestmark = pytest.mark.browser

WIDTHS = (360, 390, 500, 1000, 1200, 1280)


def until(page, expression):
    """Wait for an expression to be true; the page forbids what Playwright's own waiting does."""
    for _ in range(100):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(50)
    raise AssertionError(f"not in five seconds: {expression}")


@pytest.fixture(scope="module")
def files(calibration, hostile, tmp_path_factory):
    folder = tmp_path_factory.mktemp("browser")
    found = {"good": calibration.report(folder / "good.html"), "hostile": hostile.report(folder / "hostile.html")}
    found["wide"] = folder / "wide.html"
    text = found["good"].read_text(encoding="utf-8").replace('"Model"', '"MWMWMWMWMWMWMW, MWMWMWMWMWMW (recommended)"')
    found["wide"].write_text(text, encoding="utf-8")
    return {name: path.as_uri() for name, path in found.items()}


@pytest.fixture
def opened(browser, files):
    """A function: the page of a file at a width, with what it asked for and complained of."""
    contexts = []

    def open_page(name="good", width=1280, opens=""):
        context = browser.new_context(viewport={"width": width, "height": 900})
        contexts.append(context)
        page = context.new_page()
        page.asked, page.said = [], []
        page.on("request", lambda request: page.asked.append(request.url))
        page.on("console", lambda message: page.said.append(message.text))
        page.on("pageerror", lambda error: page.said.append(str(error)))
        page.goto(files[name])
        until(page, "'drawn' in document.documentElement.dataset")
        if opens:
            page.evaluate(f"document.querySelector('{opens}').open = true")
            page.wait_for_timeout(200)
        return page

    yield open_page
    for context in contexts:
        context.close()


@pytest.mark.parametrize("name", ["good", "hostile"])
@pytest.mark.parametrize("width", WIDTHS)
def test_it_draws_in_its_width_and_asks_for_nothing(opened, files, name, width):
    page = opened(name, width)
    page.evaluate("document.querySelectorAll('details').forEach(part => { part.open = true; })")
    page.wait_for_timeout(500)
    drawn = page.evaluate("[...document.querySelectorAll('.picture')].map(p => p.querySelectorAll('.trace').length)")
    assert drawn
    assert min(drawn) >= 2
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    wider = "[...document.querySelectorAll('.wide:has(.filter)')].filter(t => t.scrollWidth > t.clientWidth).length"
    assert name == "hostile" or page.evaluate(wider) == 0
    widths = page.evaluate("[...document.querySelectorAll('.main-svg')].map(s => s.getBoundingClientRect().right)")
    assert max(widths) <= width
    assert page.asked == [files[name]]
    assert page.said == []
    assert "owned" not in page.title()[:5]
    assert page.locator(".picture a").count() == 0


def test_a_script_that_is_not_its_own_does_not_run(opened):
    page = opened()
    page.evaluate(
        """() => {
            const script = document.createElement('script'), image = new Image();
            script.textContent = 'document.title = "owned"';
            image.src = 'https://example.org/x.png';
            document.body.append(script, image);
        }"""
    )
    page.wait_for_timeout(100)
    assert page.title() == "Calibration of knocked.csv"
    assert any("Content Security Policy" in text for text in page.said)


def shown(page, picture):
    """Which entries of a picture's legend are drawn."""
    return page.evaluate(
        f"""Object.fromEntries(document.querySelector('[data-picture="{picture}"]').data
            .filter(t => t.showlegend).map(t => [t.name.split(':')[0], t.visible !== 'legendonly']))"""
    )


def test_the_legend_takes_components_away_in_every_view(opened):
    page = opened(opens="#axis1")
    before = shown(page, "fit1")
    assert all(before.values())
    assert {"Allan deviation", "Model", "WN", "RW"} <= set(before)
    entry = page.locator('[data-picture="fit1"] .traces', has_text="WN: ").locator(".legendtoggle")
    entry.click()
    until(page, """document.querySelector('[data-picture="fit1"]').data.some(t => t.visible === 'legendonly')""")
    assert shown(page, "fit1") == {**before, "WN": False}
    page.get_by_role("button", name="Wavelet variance").click()
    after = shown(page, "fit1")
    assert [name for name, there in after.items() if not there] == ["WN"]
    page.wait_for_timeout(500)  # two clicks in a hurry are a double click
    entry.click()
    until(page, """document.querySelector('[data-picture="fit1"]').data.every(t => t.visible !== 'legendonly')""")


def test_view_and_units_change_the_axes(opened):
    page = opened()
    title = page.locator('[data-picture="sensor1-1"] .ytitle')
    assert title.text_content() == "Allan deviation (deg/h)"
    page.get_by_role("button", name="rad/s, m/s²").click()
    assert title.text_content() == "Allan deviation (rad/s)"
    page.get_by_role("button", name="Wavelet variance").click()
    assert title.text_content() == "Wavelet variance (rad²/s²)"
    assert page.locator("button[aria-pressed=true]").all_text_contents() == ["Wavelet variance", "rad/s, m/s²"]


def test_values_stand_under_the_pointer(opened):
    page = opened(opens="#axis1")
    place = page.locator('[data-picture="fit1"]')
    place.scroll_into_view_if_needed()
    points = place.locator(".scatterlayer .points path")
    box = points.nth(points.count() // 2).bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    hover = place.locator(".hovertext")
    hover.wait_for()
    text = hover.text_content()
    assert "τ = " in text
    assert "deg/h" in text
    assert "95 % limits, any noise: " in text


def test_copy_buttons_copy(opened):
    page = opened(opens="#files")
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    button = page.locator("#files button.copy").first
    button.click()
    until(page, "document.querySelector('#files button.copy').textContent === 'Copied'")
    assert page.evaluate("navigator.clipboard.readText()") == page.locator("#files pre").first.text_content()


def test_copy_works_where_the_clipboard_is_closed(opened):
    page = opened(opens="#cite")
    page.evaluate("() => { navigator.clipboard.writeText = () => Promise.reject(new Error('closed')); }")
    page.locator("#cite button.copy").click()
    until(page, "document.querySelector('#cite button.copy').textContent === 'Copied'")
    page.context.grant_permissions(["clipboard-read"])
    assert "@article{balamuta2018," in page.evaluate("navigator.clipboard.readText()")


def test_it_prints_without_buttons_and_with_everything_open(opened, calibration):
    page = opened(width=360)
    page.emulate_media(media="print")
    for what in ("nav", ".controls", ".copy"):
        assert not page.locator(what).first.is_visible()
    page.emulate_media(media="screen")
    widths = "[...document.querySelectorAll('.picture > .plot-container')].map(p => p.firstChild.clientWidth)"
    on_screen = page.evaluate(widths)
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert set(page.evaluate(widths)) <= {680, 330, 305}
    assert page.locator("details:not([open], .screen)").count() == 0
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    # Figures in folded parts are drawn again when the parts are opened.
    assert page.evaluate(widths)[: len(on_screen)] == on_screen
    page.emulate_media(media="print")
    printed = page.pdf(format="A4")
    assert printed.startswith(b"%PDF")
    # A page for each axis, and at most two before and two after them.
    assert len(calibration) < printed.count(b"/Type /Page\n") <= len(calibration) + 4


def test_no_legend_is_cut(opened):
    page = opened("wide", width=360, opens="#axis1")
    assert "MWM" in page.locator('[data-picture="fit1"] .legend').text_content()
    cut = """[...document.querySelectorAll('.legend')].map(legend => {
        const right = (part) => part.getBoundingClientRect().right;
        return Math.max(...[...legend.querySelectorAll('.legendtext')].map(right)) - right(legend.querySelector('.bg'));
    })"""
    assert max(page.evaluate(cut)) <= 0
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert max(page.evaluate(cut)) <= 0


def test_without_scripts_the_numbers_are_there(browser, files, calibration):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(files["good"])
    assert calibration.datasheets["gyro_x"]["N"].text() in page.locator("#axis1").text_content()
    assert "need JavaScript" in page.locator("#curves").inner_text()
    context.close()


def test_the_first_screen_is_folded_and_short(opened, calibration):
    page = opened()
    assert page.evaluate("document.documentElement.scrollHeight") < 12_000
    assert page.locator(".axis[open]").count() == 0
    page.locator("nav a", has_text="Gyroscope X").click()
    until(page, "document.querySelector('#axis1').open")
    until(page, "document.querySelector('#axis1 .main-svg') !== null")


def test_the_page_follows_a_dark_scheme(opened):
    page = opened()
    light = page.evaluate("getComputedStyle(document.body).backgroundColor")
    page.emulate_media(color_scheme="dark")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") != light


def test_the_report_of_nothing_but_one_axis(browser, imu, tmp_path):
    path = gmwm.calibrate(imu, "WN + RW", axes=["gyro_x"]).report(tmp_path / "one.html")
    page = browser.new_page()
    page.goto(path.as_uri())
    until(page, "document.documentElement.dataset.drawn === '1'")
    page.close()
