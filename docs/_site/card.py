"""What other programs show for a link to a page: its title, a sentence, and the card of docs/pictures/logo.py."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

SENTENCE = (
    "Noise models of inertial sensors, with confidence intervals, from a recording at rest to the file of a filter."
)


def describe(app: Sphinx, page: str, template: str, context: dict[str, object], doctree: object) -> None:
    """Add the metadata of a page (The Open Graph protocol, ogp.me)."""
    base = app.config.html_baseurl or context["content_root"]
    tags = {
        "og:type": "website",
        "og:site_name": "gmwm",
        "og:title": str(context.get("title") or "gmwm"),
        "og:description": SENTENCE,
        "og:image": f"{base}_static/card.png",
        "og:image:alt": "The logo and the name of gmwm",
    }
    lines = "".join(f'<meta property="{name}" content="{escape(text)}">\n' for name, text in tags.items())
    context["metatags"] = (
        f'{context.get("metatags", "")}<meta name="description" content="{escape(SENTENCE)}">\n{lines}'
    )


def setup(app: Sphinx) -> dict[str, bool]:
    """When a page is written."""
    app.connect("html-page-context", describe)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
