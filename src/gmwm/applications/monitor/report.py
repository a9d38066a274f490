"""Summary of a monitor as one self-contained HTML page."""

from __future__ import annotations

import base64
import io
import os
from pathlib import Path, PureWindowsPath
from typing import Any

from gmwm.applications.monitor import Trace
from gmwm.base.atomic_files import write_text
from gmwm.base.errors import OptionError
from gmwm.base.text import duration_text, version
from gmwm.showing.reports.write import environment, part


def monitor_data(trace: Trace) -> dict[str, Any]:
    """Return the content of the page, without the plot, as plain data."""
    monitor = trace.monitor
    rows = [["Time (s)", "Began (s)", "Axis", "Kind", "Event"]]
    rows += [
        [f"{event.time:.2f}", f"{event.began:.2f}", event.axis or "unit", event.kind, event.description]
        for event in trace.events
    ]
    facts = [
        *([("Source", PureWindowsPath(trace.source).name)] if trace.source else []), ("Axes", ", ".join(monitor.axes)),
        ("Duration", duration_text(monitor.samples / monitor.rate)), ("Samples", str(monitor.samples)),
        ("Sampling rate", f"{monitor.rate:g} Hz"), ("Time between false alarms", duration_text(monitor.every)),
        ("Baseline", ", ".join(monitor.baselines) or "none: the models alone"),
    ]  # fmt: skip
    models = [["Axis", "Model"], *([axis, model.structure] for axis, model in monitor.models.items())]
    return {
        "title": "Monitor of a sensor at rest", "gmwm": version(), "state": "bad" if trace.events else "good",
        "headline": trace.summary(), "facts": facts, "rows": rows, "models": models,
    }  # fmt: skip


def monitor_report(trace: Trace, path: str | os.PathLike[str]) -> Path:
    """Write the summary of a monitor as HTML. `Trace.report` describes the arguments."""
    file = Path(path)
    if file.suffix.lower() not in (".html", ".htm"):
        raise OptionError(argument="path", expected="a file name that ends in .html", got=str(path))
    write_text(file, page(trace))
    return file


def page(trace: Trace) -> str:
    """Return the summary as HTML, which includes the plot."""
    buffer = io.BytesIO()
    trace.plot().savefig(buffer, format="png", dpi=120)
    template = environment().from_string(part("page/monitor.html"))
    html: str = template.render(
        **monitor_data(trace),
        policy="default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'",
        style=part("page/report.css"), picture=base64.b64encode(buffer.getvalue()).decode(),
    )  # fmt: skip
    return html
