"""How Sphinx builds the site: `make docs`. Nothing here or in the pages asks the network, when built or when read."""

import os
import sys
from pathlib import Path

import gmwm

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]

project = "gmwm"
author = "the gmwm developers"
copyright = "the gmwm developers, BSD-3-Clause"
version = release = gmwm.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_design",
    "_site.formulas",
    "_site.pictures",
    "_site.docstrings",
    "_site.pages",
    "_site.card",
]
# README.md is the index for who reads these pages on GitHub; index.md is the site's.
exclude_patterns = ["README.md", "_site", "**/.ipynb_checkpoints"]
nitpicky = True
# Words like "array_like" and "(J,) array" are words, not names of classes.
nitpick_ignore_regex = [("py:class", ".*"), ("py:obj", ".*")]
default_role = "literal"
# Dashes only: what stands between quotes is typed as it stands.
smartquotes_action = "D"

myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
myst_dmath_double_inline = True
nb_execution_mode = "off"
suppress_warnings = ["myst.header", "myst.xref_ambiguous"]

autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True, "exclude-members": "__init__, __new__"}
napoleon_google_docstring = False
napoleon_use_param = False
napoleon_use_rtype = False
napoleon_custom_sections = [("Attributes", "params_style")]
add_module_names = False
python_use_unqualified_type_names = True
maximum_signature_line_length = 72
toc_object_entries_show_parents = "hide"

html_theme = "furo"
html_title = f"gmwm {version}"
html_logo = "_static/logo.svg"
html_favicon = "_static/icon.svg"
# Where the site is published. Cards of links need the whole address of their picture.
html_baseurl = os.environ.get("GMWM_SITE", "")
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = [("site.js", {"defer": "defer"}), ("versions.js", {"defer": "defer"})]
html_math_renderer = "outlines"
html_copy_source = False
html_show_sphinx = False
html_show_sourcelink = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#005a9c", "color-brand-content": "#005a9c"},
    "dark_css_variables": {"color-brand-primary": "#7ab8f5", "color-brand-content": "#7ab8f5"},
}
# Every colour of code against its background in a contrast of 4.5 at least; they come with the theme.
pygments_style = "a11y-high-contrast-light"
pygments_dark_style = "a11y-high-contrast-dark"
html_search_scorer = str(Path(__file__).with_name("_static") / "scorer.js")
