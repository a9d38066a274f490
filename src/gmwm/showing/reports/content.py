"""Content of a report, as strings, numbers and lists, and the sections that other packages add."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pkgutil import resolve_name
from typing import Any

import numpy as np

from gmwm.base.errors import GmwmError, OptionError
from gmwm.base.extras import admit_guests
from gmwm.base.remarks import Dialect, texts
from gmwm.base.text import p_relation, p_text, round_fixed, round_text, version
from gmwm.base.units import by_sensor, find_unit, parse_unit
from gmwm.calibration.findings import certificate_of, rejected_axes
from gmwm.calibration.number_verdicts import NumberVerdict
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.calibration.summary_text import extent_text, legend, model_words, outliers_word, rows_of, short_legend
from gmwm.calibration.tables import SENSORS
from gmwm.choosing.datasheets.entry import Entry, significant
from gmwm.choosing.selection import Ranking
from gmwm.choosing.selection.ranking import MOST_CANDIDATES_LISTED
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.regression import Regression
from gmwm.measuring.regression.against import WARM_UP
from gmwm.measuring.spectrum import PowerSpectrum
from gmwm.showing.exporters import export, export_formats
from gmwm.showing.plots.labels import DATASHEET_UNIT, axis_title
from gmwm.showing.reports import figures
from gmwm.showing.reports.verdict import Facts, filter_tables, notes, recording_facts, title_of, verdict
from gmwm.theory.processes.oscillator import name_in_text

Rows = list[list[str]]  # rows of a table below a row of headings; empty if there is nothing to show


def spectrum_tables(spectrum: PowerSpectrum | None) -> dict[str, Rows]:
    """Return the tables "lines" and "bumps" of a spectrum. Amplitudes are in datasheet units if the signal has such."""
    if spectrum is None:
        return {"lines": [], "bumps": []}
    unit, factor = _amplitude_unit(spectrum.unit)
    lines = [
        [
            f"{line.frequency:.5g}", f"{significant(line.frequency_error, 1)}", significant(factor * line.amplitude, 3),
            significant(factor * line.amplitude_error, 1),
            "below the resolution" if line.narrow else significant(line.width, 2), significant(line.height, 3),
            line.multiple,
        ]
        for line in spectrum.lines
    ]  # fmt: skip
    bumps = [
        [f"{bump.frequency:.4g}", significant(bump.width, 2), significant(bump.quality, 2), significant(bump.height, 3)]
        for bump in spectrum.bumps
    ]
    heads = ["Frequency (Hz)", "Standard error (Hz)", f"Amplitude{unit}", "Standard error", "Width (Hz)"]
    return {
        "lines": [[*heads, "Height above the level", "Harmonic"], *lines] if lines else [],
        "bumps": [["Frequency (Hz)", "Width (Hz)", "Q", "Height above the level"], *bumps] if bumps else [],
    }


def _amplitude_unit(unit: str) -> tuple[str, float]:
    """Return the unit of amplitudes in parentheses, and the conversion factor to it from the unit of the signal."""
    definition = find_unit(unit)
    if definition is None:
        return f" ({unit})" if unit else "", 1.0
    shown = parse_unit(DATASHEET_UNIT[definition.quantity], definition.quantity)
    return f" ({shown.name})", definition.factor / shown.factor


METHOD = (
    "J. Balamuta, S. Guerrier, R. Molinari and W. Yang, A Computationally Efficient Framework for Automatic Inertial "
    "Sensor Calibration, IEEE Sensors Journal, 2018 (preprint arXiv:1603.05297)."
)
"""The paper that describes the method."""

_BIBTEX = """@software{{gmwm,
  title = {{gmwm: Stochastic calibration of inertial sensors by the Generalized Method of Wavelet Moments}},
  author = {{{{the gmwm developers}}}},
  version = {{{version}}},
  license = {{BSD-3-Clause}}
}}

@article{{balamuta2018,
  title = {{A Computationally Efficient Framework for Automatic Inertial Sensor Calibration}},
  author = {{Balamuta, James and Guerrier, Stéphane and Molinari, Roberto and Yang, Wenchao}},
  journal = {{IEEE Sensors Journal}},
  year = {{2018}},
  note = {{arXiv:1603.05297}}
}}"""


def citation() -> dict[str, str]:
    """Return the citations of the software and of the method as text, and both as BibTeX."""
    software = (
        f"The gmwm developers, gmwm: Stochastic calibration of inertial sensors by the Generalized Method of Wavelet "
        f"Moments, version {version()}."
    )
    return {"software": software, "method": METHOD, "bibtex": _BIBTEX.format(version=version())}


FIRST = "kalibr"  # the format that is shown first
LONGEST_FILE = 40_000
"""Largest number of characters of a file in a report; tests/reports/test_report_page.py limits the size of a report."""


def configurations(calibration: Calibration) -> tuple[list[dict[str, str]], list[str]]:
    """Return `name`, `title` and `text` of each file, and for each format that cannot be written the reason."""
    written, refused = [], []
    for name, title in sorted(export_formats().items(), key=lambda item: item[0] != FIRST):
        try:
            text = export(calibration, format=name)
        except GmwmError as error:
            refused.append(f"{title}: {error}")
            continue
        if len(text) > LONGEST_FILE:
            refused.append(f"{title}: too long for the report. Write it with `gmwm export --format {name}`.")
            continue
        written.append({"name": name, "title": title[:1].upper() + title[1:], "text": text})
    return written, refused


def report_data(calibration: Calibration) -> dict[str, Any]:
    """Return the content of a report as plain data: verdict, tables, figures, configuration files and citation.

    Remarks are HTML in which names from files are escaped. All other strings are plain text, which a template must
    escape.

    Parameters
    ----------
    calibration : Calibration
        The result of `calibrate` or `Calibration.load`.

    Returns
    -------
    dict
        The content, with the keys `title`, `verdict`, `notes`, `recording`, `settings`, `confidence`, `tables`,
        `sensors`, `axes`, `outliers`, `outlier_tests`, `sections`, `configurations`, `left_out`, `citation`,
        `pictures` and `gmwm`.

    Raises
    ------
    OptionError
        If the argument is not a Calibration.

    Examples
    --------
    >>> from gmwm import calibrate, simulate
    >>> imu = simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=20_000, rng=1)
    >>> data = report_data(calibrate(imu, within="WN + RW"))
    >>> data["axes"][0]["numbers"][0]["symbol"], data["verdict"]["state"]
    ('N', 'good')
    """
    from gmwm.calibration.result import Calibration

    if not isinstance(calibration, Calibration):
        raise OptionError(
            f"calibration must be a Calibration; got {type(calibration).__name__}",
            argument="calibration",
            advice="Make one with `gmwm.calibrate(recording)` or `gmwm.Calibration.load(path)`.",
        )
    pictures: dict[str, Any] = {}
    sensors = filter_tables(calibration)
    curves = figures.sensor_pictures(calibration)
    for k, table in enumerate(sensors, 1):
        drawn = {f"sensor{k}-{n}": picture for n, picture in enumerate(curves.get(table["sensor"], ()), 1)}
        pictures |= drawn
        table["pictures"] = list(drawn)
    files, refused = configurations(calibration)
    misfits = rejected_axes(calibration)
    axes = []
    for k, (name, axis) in enumerate(calibration.axes.items(), 1):
        drawn = _pictures(axis)
        pictures |= {f"{kind}{k}": variants for kind, variants in drawn.items()}
        names = {kind: f"{kind}{k}" if kind in drawn else "" for kind in PICTURES}
        axes.append(
            {"id": f"axis{k}", **names, **_axis(name, axis, name in misfits, calibration.number_verdicts[name])}
        )
    return {
        "title": title_of(calibration),
        "extent": extent_text(calibration),
        "verdict": verdict(calibration),
        "notes": notes(calibration),
        "recording": recording_facts(calibration),
        "settings": _settings(calibration),
        "tables": [
            {"title": SENSORS.get(sensor, sensor or "Axes"), "rows": rows_of(members, calibration.number_verdicts)}
            for sensor, members in by_sensor(calibration.axes).items()
        ],
        "legend": legend(calibration),
        "sensors": sensors,
        "axes": axes,
        "outliers": [_outliers(name, axis) for name, axis in calibration.axes.items()],
        "outlier_tests": _outlier_tests(calibration),
        "confidence": f"{100 * calibration.settings.confidence:g} %",
        "short_legend": short_legend(calibration),
        "sections": {name: asdict(section) for name, section in sections(calibration).items()},
        "configurations": files,
        "left_out": refused,
        "citation": citation(),
        "pictures": pictures,
        "gmwm": version(),
    }


PICTURES = ("fit", "distance", "spectrum", "regression", "recordings")  # pictures of an axis, in the order of the page


def _pictures(axis: AxisCalibration) -> dict[str, Any]:
    """Return the pictures of an axis by kind, without those that it does not have."""
    fit, distance = figures.axis_pictures(axis)
    pictures = {"fit": fit, "distance": distance}
    if axis.spectrum is not None:
        pictures["spectrum"] = figures.spectrum_pictures(axis.spectrum, axis.fit.model)
    if axis.regression is not None:
        pictures["regression"] = figures.regression_pictures(axis.regression)
    if axis.replicates is not None:
        pictures["recordings"] = figures.recordings_pictures(axis.replicates)
    return pictures


def _settings(calibration: Calibration) -> Facts:
    options = calibration.settings
    robust = {"auto": "where a test finds outliers", True: "everywhere", False: "never"}[options.robust]
    return [
        ("Largest model", "searched for" if options.searched else round_fixed(str(options.within))),
        *([("Given models", round_fixed("; ".join(f"{a}: {m}" for a, m in options.models.items())))]
          if options.models else []),
        ("Weights", options.weighting),
        ("Criterion", options.criterion),
        ("Robust wavelet variance", f"{robust}, efficiency {options.efficiency:g}"),
        ("Confidence", f"{100 * options.confidence:g} %"),
        ("Seed", str(options.seed)),
    ]  # fmt: skip


def _axis(name: str, axis: AxisCalibration, rejected: bool, verdicts: Mapping[str, NumberVerdict]) -> dict[str, Any]:
    fit, ranking = axis.fit, axis.ranking
    # The table marks the recommended and equivalent models. A model is rejected by the test for all axes.
    hidden = ("model", "equal") if rejected else ("model", "equal", "ranking")
    shown = [remark.about("") for remark in ranking.remarks if remark.facts.get("case") not in hidden]
    return {
        "axis": name,
        "title": axis_title(name),
        "model": fit.model.structure,
        "words": model_words(fit.model),
        "numbers": [
            _number(entry, verdicts.get(entry.symbol))
            for entry in (*axis.datasheet.entries, *(axis.rest.entries if axis.rest else ()))
        ],
        "parameters": _parameters(axis),
        "test": _test(axis, rejected),
        "rejected": rejected and not axis.model_error,  # intervals include this error
        "certificate": _certificate(fit),
        "ranking": {"rows": _ranking_rows(ranking), "remarks": texts(shown, Dialect.HTML)},
        "search": [step.text() for step in axis.search],
        "remarks": texts((remark.about("") for remark in axis.remarks), Dialect.HTML),
        "peaks": spectrum_tables(axis.spectrum),
        "conditions": regression_table(axis.regression),
        "replicates": [] if axis.replicates is None else axis.replicates.table(),
    }


def regression_table(regression: Regression | None) -> dict[str, Any]:
    """Return a text on a regression, and a table of coefficients with headings first; {} without one."""
    if regression is None:
        return {}
    rows = [["Column", "Coefficient", "95 % interval", "Unit", "p"]]
    for name, coefficient in regression.items():
        low, high = coefficient.interval()
        value = f"{coefficient.value:.4g} ± {coefficient.error:.2g}"
        rows.append([name, value, _interval(low, high), coefficient.unit, p_text(coefficient.pvalue)])
    state = "removed before the noise was measured" if regression.applied else "not removed"
    zero = ", ".join(f"{name} = {value:g}" for name, value in regression.references.items() if name != WARM_UP)
    text = f"Effect of {regression.against}: {state}. Joint F test: p {p_relation(regression.pvalue)}."
    return {"text": text + (f" The effect is zero at {zero}." if zero else ""), "rows": rows}


def _test(axis: AxisCalibration, rejected: bool) -> str:
    """Describe one axis's goodness-of-fit test; the level is for all axes, as single p < 5 % occur by chance."""
    if axis.test is None:
        return "No test: there are too few levels"
    summary = axis.test.summary(rejected and axis.test.pvalue <= 0.05)
    return f"{summary[:1].upper()}{summary[1:]}"


def _ranking_rows(ranking: Ranking) -> list[list[str]]:
    """Return table rows of the best candidates and of all candidates equivalent to the best. The first has headings."""
    rows = [["Model", "", "Criterion", "= loss", "+ optimism", "Difference from the best ± standard error"]]
    listed = [c for k, c in enumerate(ranking.distinct) if k < MOST_CANDIDATES_LISTED or c.equivalent or c.recommended]
    for candidate in listed:
        word = "recommended" if candidate.recommended else "equivalent" if candidate.equivalent else ""
        wic = candidate.wic
        numbers = (f"{x:.2f}" if abs(x) < 1000 else f"{x:.5g}" for x in (wic.value, wic.loss, wic.optimism))
        rows.append([round_fixed(ranking.label(candidate)), word, *numbers, ranking.difference_text(candidate)])
    more = len(ranking.distinct) - len(listed)
    return [*rows, *([[f"… and {more} more", *[""] * 5]] if more else [])]


def _certificate(fit: Fit) -> str:
    """Describe the certificate of the global optimum in words; "" if there is none."""
    remark = certificate_of([fit])
    return "" if remark is None else remark.text(Dialect.PYTHON)


def _number(entry: Entry, verdict: NumberVerdict | None) -> dict[str, Any]:
    """Return a number as text in its usual unit, in the SI unit, and in other units, and ✗ if it is refused."""
    usual, other = entry.units[0], [unit for unit in entry.units[1:] if unit != entry.unit]
    at = "" if entry.tau is None else f" at {significant(entry.tau, 2)} s"
    return {
        "symbol": entry.name,
        "title": entry.title + at,
        "datasheet": entry.text(usual),
        "mark": verdict.usability.mark if verdict and verdict.refused else "",
        "si": entry.text("si"),
        "also": [_short(entry, unit) for unit in other],
    }


def _short(entry: Entry, unit: str) -> str:
    """Format a number without its interval. A number that may be zero is given by its upper limit."""
    value, low, high, _ = entry.in_units(unit)
    estimated = low is not None and high is not None and math.isfinite(high) and not entry.upper_only
    return f"{significant(value, 4)} {unit}" if estimated else entry.text(unit)


def _parameters(axis: AxisCalibration) -> list[dict[str, str]]:
    """Return the parameters of the discrete-time model as texts, with values per sample and intervals."""
    fit = axis.fit
    units = fit.units()
    rows = []
    for term, process in fit.model.by_term.items():
        of_frequency = f" of {shown}" if (shown := name_in_text(term, process)) != term else ""
        for parameter in process.parameters:
            name = f"{term}.{parameter.name}"
            nothing = name in fit.undetermined
            interval = axis.intervals.get(name)
            held = process.is_fixed(parameter.name)
            rows.append({
                "name": name, "symbol": parameter.symbol, "title": parameter.description + of_frequency,
                "value": "undetermined: the term is zero" if nothing else f"{fit.parameters[name]:.5g}",
                "interval": "fixed" if held else "" if interval is None else _interval(*interval),
                "unit": units[name],
            })  # fmt: skip
    return rows


def _interval(low: float, high: float) -> str:
    if not math.isfinite(high):
        return "not determined"
    return f"{low:.4g} … {high:.4g}"


def _outliers(name: str, axis: AxisCalibration) -> dict[str, str]:
    """Return the result of the outlier test of an axis, which compares the classical and robust wavelet variances."""
    verdict, robust = axis.verdict, axis.fit.wavelet_variance.robust
    row = {"axis": name, "fitted": "robust" if robust else "classical", "p": "", "most": ""}
    row["found"] = outliers_word(axis)
    if verdict is None:
        return row
    tested = verdict.tested & np.isfinite(verdict.excess)
    if np.any(tested):
        most = int(np.argmax(np.where(tested, verdict.excess, -np.inf)))
        sign = "+" if verdict.excess[most] >= 0 else ""
        row["most"] = (
            f"{sign}{round_text(100 * float(verdict.excess[most]))} % at {significant(verdict.tau[most], 3)} s"
        )
    return row | {"p": p_text(verdict.pvalue)}


def _outlier_tests(calibration: Calibration) -> list[str]:
    """Return the results of the outlier tests as HTML, once for axes with the same result."""
    tests = {name: axis.verdict for name, axis in calibration.axes.items() if axis.verdict is not None}
    return texts((remark.about(name) for name, verdict in tests.items() for remark in verdict.remarks), Dialect.HTML)


GROUP = "gmwm.reports"
"""Group of the entry points of sections. The name of an entry point is the name of the section."""
ENTRY_POINTS = {"budget": "gmwm.applications.navigation.table:budget_section"}
"""Entry points of the package itself. They are loaded like those of other packages."""


@dataclass(frozen=True, kw_only=True)
class Section:
    """A section of a report.

    Attributes
    ----------
    title : str
        Heading.
    text : str
        A paragraph. Text between backticks is shown as code.
    rows : sequence of sequences of str
        Table with its heading in the first row; empty for none.
    remarks : sequence of str
        Paragraphs below the table, as HTML in which names from files are escaped.
    """

    title: str
    text: str = ""
    rows: Sequence[Sequence[str]] = ()
    remarks: Sequence[str] = ()


@cache
def _registry() -> dict[str, Callable[[Calibration], Section | None]]:
    registry = {name: resolve_name(place) for name, place in ENTRY_POINTS.items()}
    admit_guests(GROUP, registry.setdefault)
    return registry


def sections(calibration: Calibration) -> dict[str, Section]:
    """Return the sections of a report by name. A function that returns None adds no section."""
    contents = {name: function(calibration) for name, function in _registry().items()}
    return {name: section for name, section in contents.items() if section is not None}
