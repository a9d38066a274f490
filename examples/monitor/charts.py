"""Charts of the monitor for PlotJuggler and Foxglove.

python examples/monitor/charts.py results/calibration.json unit.bag --output charts

Writes charts.csv with plotjuggler.xml, and charts.mcap with foxglove.json. Each chart is a statistic over its
threshold, so that an alarm is at 1. The extremes of the signal are in SI units.
"""

from __future__ import annotations

import argparse
import json
import struct
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import polars as pl
from gmwm.monitor import Monitor, Trace

import gmwm

CHARTS = {"noise_up": "#d62728", "noise_down": "#1f77b4", "level": "#2ca02c"}
SIGNAL = {"smallest": "#7f7f7f", "largest": "#7f7f7f"}
MAGIC = b"\x89MCAP0\r\n"
MESSAGE = {"type": "object", "properties": {name: {"type": "number"} for name in (*CHARTS, *SIGNAL)}}
LOG = {
    "type": "object",
    "properties": {
        "timestamp": {
            "type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
        },
        "level": {"type": "integer"}, "message": {"type": "string"}, "name": {"type": "string"},
    },
}  # fmt: skip
"""The fields of foxglove.Log that an event has."""
WARNING = 3
"""The level of an event in foxglove.Log."""
Row = tuple[float, str, dict[str, object]]
"""Time (s), topic and message."""


def rows_of(trace: Trace) -> Iterator[Row]:
    """Yield the charts, the extremes of the signal and the events of a monitor."""
    for axis in trace.monitor.axes:
        times, heights = trace.heights(axis)
        at, extremes = trace.signal(axis)
        for k, time in enumerate(times.tolist()):
            values = {family.replace(" ", "_"): float(height[k]) for family, height in heights.items()}
            smallest, largest = extremes[max(int(np.searchsorted(at, time, "right")) - 1, 0)].tolist()
            yield time, axis, {**values, "smallest": smallest, "largest": largest}
    for event in trace.events:
        stamp = {"sec": int(event.time), "nsec": int(event.time % 1 * 1e9)}
        yield event.time, "events", {"timestamp": stamp, "level": WARNING, "message": str(event), "name": "gmwm"}


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """Write the charts as a table with a column `axis/chart` for each."""
    table: dict[float, dict[str, object]] = {}
    for time, topic, message in rows:
        if topic != "events":
            table.setdefault(time, {"time": time}).update({f"{topic}/{name}": v for name, v in message.items()})
    pl.DataFrame([table[time] for time in sorted(table)]).write_csv(path)


def write_mcap(rows: Sequence[Row], axes: Sequence[str], path: Path) -> None:
    """Write the rows as messages in JSON, with a topic for each axis and one for the events. Source: mcap.dev/spec."""
    topics = [*axes, "events"]
    out = bytearray(MAGIC + _record(1, _text("") + _text("gmwm")))
    for number, (name, schema) in enumerate((("gmwm.Charts", MESSAGE), ("foxglove.Log", LOG)), 1):
        out += _record(3, struct.pack("<H", number) + _text(name) + _text("jsonschema") + _text(json.dumps(schema)))
    for number, topic in enumerate(topics):
        schema_number = 2 if topic == "events" else 1
        out += _record(4, struct.pack("<HH", number, schema_number) + _text(f"/{topic}") + _text("json") + _text(""))
    for number, (time, topic, message) in enumerate(sorted(rows, key=lambda row: row[0])):
        stamp = round(time * 1e9)
        head = struct.pack("<HIQQ", topics.index(topic), number, stamp, stamp)
        out += _record(5, head + json.dumps(message).encode())
    out += _record(15, struct.pack("<I", 0)) + _record(2, struct.pack("<QQI", 0, 0, 0)) + MAGIC
    path.write_bytes(out)


def plotjuggler_layout(axes: Sequence[str]) -> ElementTree.ElementTree[ElementTree.Element]:
    """Return a layout with a tab for each axis: its charts above its signal."""
    root = ElementTree.Element("root")
    tabs = ElementTree.SubElement(root, "tabbed_widget", {"name": "Main Window", "parent": "main_window"})
    for axis in axes:
        tab = ElementTree.SubElement(tabs, "Tab", tab_name=axis, containers="1")
        container = ElementTree.SubElement(tab, "Container")
        splitter = ElementTree.SubElement(container, "DockSplitter", orientation="-", sizes="0.5;0.5", count="2")
        for title, curves in ((f"{axis}: charts, alarm at 1", CHARTS), (f"{axis}: signal", SIGNAL)):
            area = ElementTree.SubElement(splitter, "DockArea", name=title)
            plot = ElementTree.SubElement(
                area, "plot", mode="TimeSeries", style="Lines", flip_x="false", flip_y="false"
            )
            for name, color in curves.items():
                ElementTree.SubElement(plot, "curve", name=f"{axis}/{name}", color=color)
    ElementTree.SubElement(tabs, "currentTabIndex", index="0")
    ElementTree.SubElement(root, "use_relative_time_offset", enabled="0")
    plugins = ElementTree.SubElement(root, "Plugins")
    loader = ElementTree.SubElement(plugins, "plugin", ID="DataLoad CSV")
    ElementTree.SubElement(loader, "default", time_axis="time", delimiter="0")
    ElementTree.indent(root, " ")
    return ElementTree.ElementTree(root)


def foxglove_layout(axes: Sequence[str]) -> dict[str, object]:
    """Return a layout with a plot of the charts of each axis, and the events as a log."""
    panels: dict[str, object] = {
        f"Plot!{axis}": {
            "title": f"{axis}: charts, alarm at 1", "isSynced": True, "xAxisVal": "timestamp", "showLegend": True,
            "paths": [
                {
                    "value": f"/{axis}.{name}", "label": name, "color": color, "enabled": True,
                    "timestampMethod": "receiveTime",
                }
                for name, color in CHARTS.items()
            ] + [{"value": "1", "label": "alarm", "enabled": True, "timestampMethod": "receiveTime"}],
        }
        for axis in axes
    }  # fmt: skip
    panels["Log!events"] = {"topicToRender": "/events", "minLogLevel": 1}
    *above, layout = panels
    tree: object = layout
    for place, panel in enumerate(reversed(above), 2):
        tree = {"direction": "column", "first": panel, "second": tree, "splitPercentage": 100 / place}
    return {
        "configById": panels, "globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1}, "layout": tree,
    }  # fmt: skip


def main(arguments: list[str] | None = None) -> Trace:
    """Monitor a recording, and write its charts and the layouts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("calibration", type=Path, help="calibration.json of the healthy sensor")
    parser.add_argument("recording", type=Path, help="recording to monitor")
    parser.add_argument("--output", type=Path, default=Path("charts"), help="folder of the files")
    options = parser.parse_args(arguments)
    recording = gmwm.read(options.recording)
    trace = Trace(Monitor(gmwm.Calibration.load(options.calibration), "30d", rate=recording.rate))
    for event in trace.watch(recording):
        print(event)
    rows, axes = list(rows_of(trace)), list(trace.monitor.axes)
    options.output.mkdir(parents=True, exist_ok=True)
    write_csv(rows, options.output / "charts.csv")
    write_mcap(rows, axes, options.output / "charts.mcap")
    plotjuggler_layout(axes).write(options.output / "plotjuggler.xml", encoding="UTF-8", xml_declaration=True)
    (options.output / "foxglove.json").write_text(json.dumps(foxglove_layout(axes), indent=1), encoding="utf-8")
    return trace


def _record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data


if __name__ == "__main__":
    main()
