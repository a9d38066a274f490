"""Build the site as `make docs` does, in less time: `python -m tests.docs.build OPTIONS`, as for Sphinx."""

import functools
import gc
import posixpath
import sys

import furo
from sphinx.cmd.build import main

menu = furo._compute_navigation_tree
menus: dict[str, str] = {}


@functools.wraps(menu)
def menu_of_folder(context):
    """The menu of a page. All pages of a folder have the same links in it, so the others get that of the first."""
    folder = posixpath.dirname(context.get("pagename", ""))
    if folder not in menus:
        menus[folder] = menu(context)
    return menus[folder]


if __name__ == "__main__":
    furo._compute_navigation_tree = menu_of_folder
    # Nodes of documents refer to each other, and nearly all stay.
    gc.set_threshold(200_000, 20, 100)
    sys.exit(main(sys.argv[1:]))
