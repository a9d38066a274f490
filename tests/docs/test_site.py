"""The site: it builds without a warning, links lead somewhere, every public name is on one page, no page is too wide.

One file, so that one process builds the site for all of these tests.
"""

import inspect
import re
import shutil
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from urllib.parse import quote, unquote, urlsplit

import pytest

import gmwm
from release.site import gather
from tests.docs.pages import DOCS, pages

pytestmark = pytest.mark.docs

ENTRY = re.compile(r"^\.\. auto(?:function|class|exception):: gmwm\.(\S+)$", re.MULTILINE)


class Page(HTMLParser):
    """Places that can be linked to, links, and what a browser loads with the page."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.places, self.links, self.loaded = set(), set(), set()
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.places.update(values[key] for key in ("id", "name") if values.get(key))
        if tag == "a" and values.get("href"):
            self.links.add(values["href"])
        if tag == "link" and values.get("href") and values.get("rel") in ("stylesheet", "icon", "preload"):
            self.loaded.add(values["href"])
        if values.get("src"):
            self.loaded.add(values["src"])


@pytest.fixture(scope="module")
def built(site):
    return {file: Page(file) for file in sorted(site.rglob("*.html"))}


def is_outside(link):
    return bool(urlsplit(link).scheme or urlsplit(link).netloc)


def test_every_page_is_in_the_site(site):
    left_out = {DOCS / "README.md"}
    wanted = {page.relative_to(DOCS).with_suffix(".html") for page in [*pages(), *DOCS.glob("validation/*.md")]} - {
        page.relative_to(DOCS).with_suffix(".html") for page in left_out
    }
    assert len(wanted) > 40
    assert {str(page) for page in wanted if not (site / page).is_file()} == set()


def broken_links(built):
    """File and link, where the file or the place in it that it leads to is not there."""
    broken = []
    for file, page in built.items():
        for link in page.links:
            if is_outside(link):
                continue
            parts = urlsplit(link)
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            places = built[target].places if target in built else {unquote(parts.fragment)}
            if not target.is_file() or (parts.fragment and unquote(parts.fragment) not in places):
                broken.append((file.name, link))
    return broken


def test_no_link_is_broken(built):
    assert sum(len(page.links) for page in built.values()) > 1000
    assert broken_links(built) == []


def test_broken_links_are_found(tmp_path):
    links = ["#here", "#gone", "other.html", "gone.html", "other.html#gone", "https://example.org"]
    one, other = tmp_path / "one.html", tmp_path / "other.html"
    one.write_text('<p id="here">' + "".join(f'<a href="{link}">x</a>' for link in links), encoding="utf-8")
    other.write_text("<p>", encoding="utf-8")
    found = broken_links({file: Page(file) for file in (one, other)})
    assert {link for _, link in found} == {"#gone", "gone.html", "other.html#gone"}


def test_pages_load_nothing_from_a_network_and_miss_nothing(built):
    for file, page in built.items():
        local = {link for link in page.loaded if not link.startswith("data:")}
        assert {link for link in local if is_outside(link)} == set(), file
        missing = {link for link in local if not (file.parent / unquote(urlsplit(link).path)).is_file()}
        assert missing == set(), file


def test_links_to_the_world_are_safe_ones(built):
    outside = {link for page in built.values() for link in page.links if is_outside(link)}
    assert outside
    # Whether they answer is not asked here, where there is no network; `pytest -rP -k world` lists them.
    print(*sorted(outside), sep="\n")
    assert {link for link in outside if urlsplit(link).scheme not in ("https", "mailto")} == set()


def test_every_public_name_is_on_exactly_one_page_of_the_api():
    entries = [name for page in (DOCS / "api").glob("*.md") for name in ENTRY.findall(page.read_text(encoding="utf-8"))]
    public = set(gmwm.__all__)
    assert len(public) > 40
    assert public - set(entries) == set()
    assert {name for name in entries if entries.count(name) > 1} == set()


def test_inherited_methods_are_documented_like_others(built):
    places = set().union(*(page.places for page in built.values()))
    inherited = [
        f"gmwm.{name}.{attribute}"
        for name, thing in [(name, getattr(gmwm, name)) for name in gmwm.__all__]
        if inspect.isclass(thing)
        for base in thing.__mro__[1:]
        if base.__name__.endswith("Methods") or base is gmwm.plots.Plotted
        for attribute in vars(base)
        if not attribute.startswith("_")
    ]
    assert {"gmwm.Fit.plot", "gmwm.Signal.plot", "gmwm.Calibration.plot"} <= set(inherited)
    assert [name for name in inherited if name not in places] == []


def test_formulas_are_drawn_not_scripted(built, site):
    theory = (site / "theory.html").read_text(encoding="utf-8")
    assert theory.count('<svg class="formula"') > 20
    scripts = {link for page in built.values() for link in page.loaded if "mathjax" in link.lower() or "katex" in link}
    assert scripts == set()


# --- in a browser, from files, without a network ------------------------------------------------------


@pytest.fixture
def page(browser):
    context = browser.new_context(viewport={"width": 1280, "height": 900}, offline=True)
    yield context.new_page()
    context.close()


TOO_WIDE = """() => [...document.querySelectorAll('article *')].filter(thing => {
    if (thing.ownerSVGElement || thing.getBoundingClientRect().right <= innerWidth + 1) return false;
    for (let around = thing.parentElement; around.tagName !== 'ARTICLE'; around = around.parentElement)
        if (['auto', 'scroll'].includes(getComputedStyle(around).overflowX)) return false;
    return true;
}).map(thing => thing.outerHTML.slice(0, 80))"""
"""What goes beyond the window and cannot be scrolled into it: the theme cuts it off, and the page is never wide."""


@pytest.mark.browser
def test_no_page_is_wider_than_its_window(site, page):
    files = sorted(site.rglob("*.html"))
    assert len(files) > 40
    wide = {}
    for file in files:
        page.goto(file.as_uri(), wait_until="load")
        for width in (1280, 390):
            page.set_viewport_size({"width": width, "height": 900})
            found = page.evaluate(TOO_WIDE)
            if found or page.evaluate("document.documentElement.scrollWidth") > width:
                wide[f"{file.relative_to(site)} at {width}"] = found
    assert wide == {}


@pytest.mark.browser
def test_what_is_too_wide_is_found(site, page):
    page.set_viewport_size({"width": 390, "height": 900})
    page.goto((site / "index.html").as_uri(), wait_until="load")
    assert page.evaluate(TOO_WIDE) == []
    page.evaluate(
        """() => {
            const line = document.createElement('p');
            line.textContent = 'x'.repeat(900);
            line.style.width = 'max-content';
            document.querySelector('article').append(line);
        }"""
    )
    assert [found[:2] for found in page.evaluate(TOO_WIDE)] == ["<p"]


FIRST = {
    "arw": "glossary.html#term-ARW",
    "angle random walk": "glossary.html#term-angle-random-walk",
    "quantisation": "glossary.html#term-quantisation-noise",
    "rosbag": "glossary.html#term-rosbag",
    "deg/h": "glossary.html#term-deg-h",
    "bias instability": "glossary.html#term-bias-instability",
    "imu.yaml": "glossary.html#term-imu.yaml",
    "install": "install.html",
    "custom process": "glossary.html#term-custom-process",
    "distinguish": "glossary.html#term-distinguish",
    "misalignment": "glossary.html#term-misalignment",
    "license": "glossary.html#term-license",
    "monte carlo": "glossary.html#term-Monte-Carlo",
    "coverage": "glossary.html#term-coverage",
    "matlab": "coming-from/imu-tools.html",
    "hadamard": "glossary.html#term-Hadamard",
    "calibrate": "api/calibration.html#gmwm.calibrate",
    "wavelet_variance": "api/variance.html#gmwm.wavelet_variance",
    "Fit.covariance": "api/fitting.html#gmwm.Fit.covariance",
}
"""What somebody types, and what should stand on top."""


def found_by(page, site, words):
    """Where the results of a search lead, in their order."""
    page.goto(f"{(site / 'search.html').as_uri()}?q={quote(words)}")
    page.wait_for_selector("#search-results li a", timeout=60_000)
    page.wait_for_function("document.querySelector('#search-results .search-summary')?.textContent.includes('found')")
    links = page.locator("#search-results > ul > li > a").evaluate_all(
        "links => links.map(a => a.getAttribute('href'))"
    )
    return [re.sub(r"\?[^#]*", "", link) for link in links]


@pytest.mark.browser
def test_search_puts_on_top_what_is_meant(site, page):
    assert {words: found_by(page, site, words)[0] for words in FIRST} == FIRST


@pytest.mark.browser
def test_search_finds_what_takes_several_words(site, page):
    wanted = {
        "confidence interval coverage": "glossary.html",
        "compare two units": "howto/recordings.html",
        "missing samples array": "howto/record.html",
        "define custom process": "contributing/add-a-process.html",
    }
    assert {words: where for words, where in wanted.items() if where not in found_by(page, site, words)} == {}


@pytest.mark.browser
def test_search_puts_history_behind_explanations(site, page):
    found = found_by(page, site, "kalibr")
    assert found.index("howto/feed.html") < found.index("changelog.html")


LEGIBLE = """() => {
    const luminance = colour => colour.match(/[\\d.]+/g).slice(0, 3).map(Number).map(x => x / 255)
        .map(x => x <= 0.03928 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4)
        .reduce((sum, x, k) => sum + x * [0.2126, 0.7152, 0.0722][k], 0);
    const behind = thing => {
        for (; thing; thing = thing.parentElement) {
            const colour = getComputedStyle(thing).backgroundColor;
            if (!/, 0\\)$|transparent/.test(colour)) return colour;
        }
        return 'rgb(255, 255, 255)';
    };
    const worst = {};
    for (const thing of document.querySelectorAll('article p, article a, article dt, article code, .highlight span')) {
        if (!thing.textContent.trim() || thing.closest('.headerlink, .sd-card')) continue;
        const pair = [luminance(getComputedStyle(thing).color), luminance(behind(thing))].sort((a, b) => b - a);
        const contrast = (pair[0] + 0.05) / (pair[1] + 0.05);
        if (contrast < 4.5) worst[thing.tagName + '.' + thing.className] = contrast.toFixed(2);
    }
    return worst;
}"""
"""Words whose contrast to what is behind them is less than WCAG 2 asks for (AA, 4.5)."""


@pytest.mark.browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_words_and_code_stand_out(site, page, scheme):
    page.emulate_media(color_scheme=scheme)
    pages = "start.html", "glossary.html", "contributing/add-a-process.html", "api/fitting.html", "coming-from/r.html"
    for name in pages:
        page.goto((site / name).as_uri(), wait_until="load")
        assert page.evaluate(LEGIBLE) == {}, name
    page.evaluate("document.querySelector('article p').style.color = getComputedStyle(document.body).backgroundColor")
    assert "P." in page.evaluate(LEGIBLE)


@pytest.mark.browser
def test_pages_ask_for_nothing_but_files_and_complain_of_nothing(site, page):
    asked, said = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    for name in ("index.html", "theory.html", "api/fitting.html"):
        page.goto((site / name).as_uri(), wait_until="load")
    assert asked
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
    assert said == []


# --- the versions, where the site is published --------------------------------------------------------


@pytest.fixture
def published(site, tmp_path):
    """The address of a site of two versions on this machine; the older one has no page `fleet.html`."""
    (tmp_path / "releases").mkdir()
    (tmp_path / "old").mkdir()
    for name in ("index.html", "start.html"):
        shutil.copy(site / name, tmp_path / "old")
    shutil.make_archive(str(tmp_path / "releases" / "docs-0.0.9"), "zip", tmp_path / "old")
    gather(site, tmp_path / "releases", tmp_path / "all")
    quiet = type("Quiet", (SimpleHTTPRequestHandler,), {"log_message": lambda *_: None})
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(quiet, directory=tmp_path / "all")) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.mark.browser
@pytest.mark.parametrize(("name", "reached"), [("start.html", "start.html"), ("fleet.html", "")])
def test_the_list_of_versions_leads_to_the_same_page_if_there_is_one(browser, published, name, reached):
    page = browser.new_page()
    page.goto(f"{published}/latest/{name}")
    page.click("text=Version: development")
    assert page.locator(".versions a").all_text_contents() == ["development", "0.0.9"]
    page.click("text=0.0.9")
    page.wait_for_url(f"{published}/0.0.9/{reached}")
    page.close()


@pytest.mark.browser
def test_a_page_that_is_opened_as_a_file_lists_no_versions(site, page):
    page.goto((site / "start.html").as_uri(), wait_until="load")
    assert page.locator(".sidebar-brand").count() == 1
    assert page.locator(".versions").count() == 0


# --- by keys, and on paper ----------------------------------------------------------------------------

SEEN = """() => {
    const thing = document.activeElement;
    const labels = thing.id ? document.querySelectorAll(`header label[for=${thing.id}]`) : [];
    return [thing, ...labels].some(box => {
        const { left, right, width, height } = box.getBoundingClientRect();
        const style = getComputedStyle(box);
        const there = width && height && left >= 0 && right <= innerWidth && style.visibility === 'visible';
        return there && style.opacity > 0 && style.outlineStyle !== 'none';
    });
}"""
"""Whether what has the focus, or the label that stands for it, is in the window's width with a line around it."""


def at(page):
    return page.evaluate("document.activeElement.id || document.activeElement.className")


@pytest.mark.browser
def test_keys_lead_only_to_what_is_seen_on_a_phone(site, page):
    page.set_viewport_size({"width": 390, "height": 800})
    page.goto((site / "start.html").as_uri(), wait_until="load")
    # Nothing slides: what has the focus is where it will be.
    page.add_style_tag(content="* { transition: none !important; }")
    stops = []
    for _ in range(12):
        page.keyboard.press("Tab")
        stops.append((at(page), page.evaluate(SEEN)))
    assert [name for name, seen in stops if not seen] == []
    assert [name for name, _ in stops[:2]] == ["__navigation", "__toc"]


@pytest.mark.browser
@pytest.mark.parametrize(("toggle", "drawer"), [("__navigation", ".sidebar-drawer"), ("__toc", ".toc-drawer")])
def test_drawers_open_and_close_by_keys(site, page, toggle, drawer):
    page.set_viewport_size({"width": 390, "height": 800})
    page.goto((site / "start.html").as_uri(), wait_until="load")
    page.focus(f"#{toggle}")
    assert not page.is_visible(f"{drawer} a >> visible=true")
    page.keyboard.press("Space")
    assert page.evaluate(f"document.querySelector('{drawer}').contains(document.activeElement)")
    page.keyboard.press("Escape")
    assert (at(page), page.is_checked(f"#{toggle}")) == (toggle, False)
    page.keyboard.press("Space")
    page.focus("article p a")
    assert not page.is_checked(f"#{toggle}")


@pytest.mark.browser
def test_boxes_that_scroll_can_be_reached_by_keys(site, page):
    page.set_viewport_size({"width": 390, "height": 800})
    page.goto((site / "start.html").as_uri(), wait_until="load")
    boxes = "[...document.querySelectorAll('article pre, article .table-wrapper')]"
    assert page.evaluate(f"{boxes}.filter(box => box.scrollWidth > box.clientWidth + 1).length") > 3
    assert page.evaluate(f"{boxes}.every(box => (box.scrollWidth > box.clientWidth + 1) === (box.tabIndex === 0))")
    assert page.locator('.caption[role="heading"]:not([aria-level])').count() == 0


@pytest.mark.browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_pictures_are_those_of_the_scheme(site, page, scheme):
    page.emulate_media(color_scheme=scheme)
    page.goto((site / "index.html").as_uri(), wait_until="load")
    other = {"light": "dark", "dark": "light"}[scheme]
    assert page.locator(f"article img.only-{scheme}").first.is_visible()
    assert not page.locator(f"article img.only-{other}").first.is_visible()
    wide = page.evaluate(f"document.querySelector('article img.only-{scheme}').naturalWidth")
    assert wide > 100


@pytest.mark.browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_paper_stands_the_text_alone_and_it_can_be_read(site, page, scheme):
    page.emulate_media(media="print", color_scheme=scheme)
    page.goto((site / "start.html").as_uri(), wait_until="load")
    assert page.evaluate(LEGIBLE) == {}
    around = "header, aside, .skip-to-content, .sidebar-toggle, .related-pages, .content-icon-container, .back-to-top"
    shown = f"things => [...document.querySelectorAll({around!r})].filter(x => x.getClientRects().length)"
    assert page.evaluate(f"({shown})().map(x => x.className)") == []
    page.emulate_media(media="screen", color_scheme=scheme)
    assert "skip-to-content muted-link" in page.evaluate(f"({shown})().map(x => x.className)")
