"""The pages that are open in browsers, each with its own results."""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import Any

from gmwm.applications.app.folders import Folders
from gmwm.applications.app.session import Session
from gmwm.applications.app.workspace import Workspace


class Desk:
    """The open pages of a server.

    Attributes
    ----------
    folders : Folders
        The files that the pages may open.
    first : Session
        The session with which a new page starts.
    places : list of str
        Names of the page elements whose content the server draws again when the state changes.
    """

    def __init__(self, folders: Folders, first: Session) -> None:
        self.folders, self.first = folders, first
        self.places: list[str] = []
        self._pages: OrderedDict[str, Workspace] = OrderedDict()
        self._lock = threading.Lock()

    def workspace(self, page: str) -> Workspace:
        """Return the workspace of a page by its identifier. A new page gets a new workspace."""
        with self._lock:
            workspace = self._pages.setdefault(page, Workspace(self.folders))
            self._pages.move_to_end(page)
            while len(self._pages) > 8:  # the results of an older page are computed again
                _, oldest = self._pages.popitem(last=False)
                oldest.jobs.cancel()
            return workspace

    def session(self, data: dict[str, Any] | None) -> Session:
        """Return the session for the data that a page has stored. Raises an error if a value is not allowed."""
        return self.first if data is None else Session.from_dict(data)

    def close(self) -> None:
        """Cancel the jobs of all pages."""
        for workspace in self._pages.values():
            workspace.jobs.cancel()
