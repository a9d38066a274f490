"""The summary has the remarks and the numbers in eighty columns; the figures show every axis."""

from dataclasses import replace

import numpy as np
import pytest

import gmwm
from gmwm.base.remarks import Quantity, Remark, Severity
from gmwm.base.text import round_text
from gmwm.calibration.summary_text import _fitting_words, short_legend
from gmwm.calibration.tables import in_order, merge_names, number
from gmwm.choosing.datasheets import Entry
from gmwm.measuring.outliers import excess_text
from gmwm.showing.plots.figure import description
from gmwm.showing.plots.imu import plot_imu
from tests.helpers import codes, only

from .conftest import WITHIN


def words(calibration):
    return " ".join(calibration.summary().split())


def test_it_fits_eighty_columns(calibration):
    for details in (False, True):
        assert max(map(len, calibration.summary(details=details).splitlines())) <= 80


@pytest.mark.parametrize(
    ("value", "low", "high", "text"),
    [
        (0.0, -1.0, 2.0, "-1 … 2"),
        (0.0, 0.0, 0.0, "0"),
        (1e-308, 0.0, 1e3, "0 … 1000"),
        (2.0, 1.9, 2.1, "2 ± 5 %"),
        (0.292, 0.264, 0.458, "0.292 +57/−10 %"),
        (2.41, 2.355, 2.425, "2.41 +0.6/−2.3 %"),
        (1.0, 0.9999, 1.5, "1 +50/−0.01 %"),
        (1.11, 0.88, 1.11 * (1 + 1e-12), "1.11 +0/−21 %"),
    ],
)
def test_a_number_of_any_size_has_an_interval(value, low, high, text):
    assert number(Entry(symbol="N", title="a number", value=value, low=low, high=high, unit="1")) == text


def test_a_model_of_many_terms_takes_one_line(calibration):
    """Widths of the numbers as in a recording of an ADIS16405: 17 columns are left for the model."""
    model = gmwm.Model.parse("2*GM + FN + ARMA(1,1) + 3*OSC")
    assert _fitting_words([model, gmwm.Model.parse("GM + FN")], 19) == ["2*GM+FN+ARMA+3*OSC", "GM+FN"]
    assert _fitting_words([model], 17) == ["2*GM+FN+4 more"]
    assert _fitting_words([model], 9) == ["7 terms"]


def test_wide_tables_are_cut_to_fewer_axes(calibration):
    found = calibration.axes["gyro_x"]
    long = {f"gyro_{'turned_' * 3}{letter}": found for letter in "xyz"}
    text = replace(calibration, axes=long, recording_remarks=()).summary(every=True, details=True)
    assert max(map(len, text.splitlines())) <= 80
    assert text.count("p of the fit") == 2
    assert all(name in text for name in long)


def test_each_sensor_has_its_table(calibration):
    text = calibration.summary(details=True)
    assert "knocked.csv" in text
    tables = text[text.index("Gyroscopes") :]
    assert tables.index("gyro_x") < tables.index("gyro_y") < tables.index("Accelerometers") < tables.index("accel_x")
    for axis, fit in calibration.items():
        assert fit.model.structure.replace(" ", "") in text
        assert calibration.axes[axis].test.pvalue_in_words in text


def test_there_is_one_line_for_each_axis(calibration):
    text = calibration.summary()
    assert len(text.splitlines()) <= 40
    for axis, result in calibration.axes.items():
        (line,) = [line for line in text.splitlines() if line.startswith(f"  {axis}  ")]
        for symbol in ("N", "K", "B"):
            if symbol in result.datasheet:
                verdict = calibration.number_verdicts[axis][symbol]
                shown = number(result.datasheet[symbol])
                assert (shown if shown.startswith("≤") else shown.partition(" ±")[0]) in line
                assert verdict.usability.mark in line


def test_long_names_of_axes_fit_eighty_columns(calibration):
    result = calibration.axes["gyro_x"]
    axes = {f"gyro_{'turned_' * 3}{letter}": result for letter in "xyz"}
    text = replace(calibration, axes=axes, recording_remarks=()).summary()
    assert max(map(len, text.splitlines())) <= 80
    assert all(name in text for name in axes)


def test_numbers_are_those_of_the_datasheets(calibration):
    text = calibration.summary(details=True)
    for sheet in calibration.datasheets.values():
        for symbol, entry in sheet.items():
            value, low, high, unit = entry.in_units("datasheet")
            if entry.upper_only:
                assert f"≤ {round_text(high, 3)}" in text
            elif (high - low) / 2 <= 0.5 * abs(value):
                assert f"{round_text(value, 3)} {number(entry).split(' ', 1)[1]}" in text
            else:
                assert f"{round_text(low)} … {round_text(high)}" in text
            assert f"{symbol} ({unit})" in text
            assert f"{symbol} {entry.title}" in " ".join(text.split()) or symbol.endswith(f" of {entry.term}")


def test_outliers_get_a_remark_with_their_size(calibration):
    verdict = calibration.verdicts["gyro_y"]
    worst = verdict.excess[verdict.exceeding].max()
    remark = only(calibration.remarks, "outliers-left-out", "gyro_y")
    assert remark.facts["excess"] == excess_text(worst)
    assert remark.facts["tau"].value in verdict.tau[verdict.excess == worst]
    assert "left out" in next(
        line for line in calibration.summary(details=True).splitlines() if line.startswith("  outliers")
    )


@pytest.mark.slow
def test_outliers_that_are_kept_get_a_remark(imu):
    found = gmwm.calibrate(imu, WITHIN, robust=False, axes=["gyro_y"])
    remark = only(found.remarks, "outliers-found:fit", "gyro_y")
    assert (remark.severity, remark.facts["line"]) == (Severity.BIASED, "no")
    assert "yes: kept" in found.summary(details=True)


def test_the_remarks_of_the_recording_are_those_of_the_calibration(imu, calibration):
    assert [*codes(calibration.recording_remarks), "knocks"] == codes(gmwm.inspect(imu).remarks)
    assert set(calibration.recording_remarks) <= set(calibration.remarks)
    for remark in calibration.recording_remarks:
        assert " ".join(remark.text().split()) in " ".join(calibration.summary(every=True).split())


@pytest.mark.slow
def test_a_drift_gets_a_remark():
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7) + DR(omega=-2e-8)"}, rate=100.0, samples=100_000, rng=1)
    found = gmwm.calibrate(imu, "WN + RW + DR")
    value, _, _, unit = found.datasheets["gyro_x"]["R"].in_units("datasheet")
    assert value < 0
    assert only(found.remarks, "drift:drift", "gyro_x").facts["rate"] == Quantity(value, unit)


@pytest.mark.slow
def test_a_rejected_model_gets_a_remark(calibration):
    assert not {"model-misfit", "model-rejected:calibration"} & {*codes(calibration.remarks)}
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=2e-11)"}, rate=100.0, samples=100_000, rng=4)
    found = gmwm.calibrate(imu, "WN")
    assert only(found.remarks, "model-misfit", "gyro_x").severity is Severity.UNUSABLE
    assert "[model-misfit]" in found.summary()


def test_the_longest_usable_scale_gets_a_remark(calibration):
    facts = only(calibration.remarks, "longest-scale").facts
    assert (facts["duration"], facts["scale"]) == (Quantity(1000.0, "s"), Quantity(163.84, "s"))
    assert facts["gaps"] == "no"


def test_the_same_remark_on_several_axes_is_one_line(calibration):
    axes = {
        axis: replace(found, fit=replace(found.fit, diagnostics=replace(found.fit.diagnostics, remarks=(REMARK,))))
        for axis, found in calibration.axes.items()
    }
    text = " ".join(replace(calibration, axes=axes).summary(every=True).split())
    assert text.count("[weights-from-data]") == 1
    assert "gyro_x, gyro_y and accel_x: " in text


REMARK = Remark.of("weights-from-data", case="iteration")


def test_rows_keep_the_order_of_every_axis():
    assert merge_names([["N", "B"], ["Q", "N", "K"], ["N", "B", "K", "T_c"]]) == ["Q", "N", "B", "K", "T_c"]
    assert merge_names([["N", "T_c[1]"], ["N", "B", "T_c[1]", "T_c[2]"]]) == ["N", "B", "T_c[1]", "T_c[2]"]


def test_the_numbers_of_a_filter_come_first():
    lists = [["N", "B", "R", "T_c[1]"], ["N", "B", "K", "T_c[1]", "T_c[2]"], ["Q", "N"]]
    assert in_order(lists) == ["N", "K", "B", "Q", "R", "T_c[1]", "T_c[2]"]


@pytest.mark.slow
def test_one_gauss_markov_term_is_in_the_row_of_the_first_of_two():
    truth = {
        "gyro_x": "GM(beta=8.0, sigma2=5e-8) + GM(beta=0.2, sigma2=2e-8) + WN(sigma2=4e-7)",
        "gyro_y": "GM(beta=2.0, sigma2=5e-8) + WN(sigma2=4e-7)",
    }
    found = gmwm.calibrate(gmwm.simulate(truth, rate=100.0, samples=200_000, rng=2), "2*GM + WN")
    assert [fit.model.structure for fit in found.values()] == ["2*GM + WN", "GM + WN"]
    rows = [line for line in found.summary(details=True).splitlines() if line.startswith("  T_c")]
    assert [row.split()[0] for row in rows] == ["T_c[1]", "T_c[2]"]
    assert rows[0].count("±") == 2


@pytest.mark.slow
@pytest.mark.parametrize("split", [True, False])
def test_the_pictures_show_every_axis(calibration, split, tmp_path):
    figure = description(plot_imu)(calibration, split=split)
    panels = [panel for row in figure.rows for panel in row if panel is not None]
    assert len(panels) == (3 if split else 2)
    calibration.plot(split=split, path=tmp_path / "calibration.png")
    assert (tmp_path / "calibration.png").read_bytes().startswith(b"\x89PNG")


def test_it_is_short_as_a_repr_and_complete_in_a_notebook(calibration):
    assert repr(calibration).startswith("Calibration(gyro_x: ")
    assert "Gyro  " in calibration._repr_html_()


@pytest.mark.slow
def test_scales_that_gaps_hide_get_a_remark(imu):
    x = imu["gyro_x"]
    pieces = tuple((start, min(start + 2000, 100_000)) for start in range(0, 100_000, 2000))
    # An hour is lost every 20 s, which is too long to be filled.
    starts = tuple((start + 360_000 * k) / 100.0 for k, (start, _) in enumerate(pieces))
    gappy = gmwm.Signal(x.values, 100.0, "rad/s", "gyro_x", segments=pieces, starts=starts)
    whole, apart = (
        only(gmwm.calibrate({"gyro_x": signal}, "GM + WN").remarks, "longest-scale").facts for signal in (x, gappy)
    )
    assert (whole["gaps"], apart["gaps"]) == ("no", "yes")
    assert apart["unbroken"] == whole["scale"]
    assert apart["scale"].value < whole["scale"].value


@pytest.mark.slow
def test_lines_are_named_by_their_frequency_the_strongest_first():
    rng, t = np.random.default_rng(1), np.arange(50_000) / 100.0
    lines = {7.3: 5e-4, 21.1: 1e-3, 33.7: 2.5e-4}
    x = 1e-3 * rng.normal(size=t.size) + sum(a * np.sin(2 * np.pi * f * t) for f, a in lines.items())
    found = gmwm.calibrate(gmwm.Signal(x, 100.0, "rad/s", "gyro_x"))
    amplitudes = [entry for symbol, entry in found.datasheets["gyro_x"].items() if symbol.startswith("A")]
    values = [entry.value for entry in amplitudes]
    assert values == sorted(values, reverse=True)
    assert values == pytest.approx(sorted(lines.values(), reverse=True), rel=0.05)
    assert all(entry.low < entry.value < entry.high < 1.2 * entry.low for entry in amplitudes)
    rows = [line.split("(")[0].strip() for line in found.summary(details=True).splitlines() if "line " in line]
    assert rows[:3] == ["line 21.1 Hz", "line 7.3 Hz", "line 33.7 Hz"]


def test_many_lines_are_counted(monkeypatch):
    monkeypatch.setattr("gmwm.calibration.summary_text.MOST_LINES", 1)
    t = np.arange(50_000) / 100.0
    x = 1e-3 * np.random.default_rng(1).normal(size=t.size)
    x += 1e-3 * np.sin(2 * np.pi * 7.3 * t) + 5e-4 * np.sin(2 * np.pi * 21.1 * t)
    text = gmwm.calibrate(gmwm.Signal(x, 100.0, "rad/s", "gyro_x")).summary(details=True)
    (row,) = (line.split() for line in text.splitlines() if line.startswith("  weaker lines"))
    assert row[-1] == "1"
    assert "line 21.1 Hz" not in text


def test_the_summary_says_why_each_model_was_chosen(calibration):
    text = calibration.summary(details=True)
    for axis in calibration:
        assert f"Why this model of {axis}?" in text
        (step,) = calibration.axes[axis].search
        assert (step.entered, step.used, step.recommended) == ("within", True, calibration[axis].model.structure)
    assert max(map(len, text.splitlines())) <= 80
    assert "Why this model" not in calibration.summary()
    restored = gmwm.Calibration.from_dict(calibration.to_dict())
    assert restored.axes["gyro_x"].search == calibration.axes["gyro_x"].search


@pytest.mark.parametrize(
    ("seconds", "text"), [((0.5, 0.5), "up to 0.5 s."), ((0.5, 0.2), "0.5 s (gyroscopes) and 0.2 s (accelerometers).")]
)
def test_the_time_that_numbers_hold_is_said_once_if_sensors_agree(calibration, seconds, text):
    ends = [
        Remark.of("walk-or-markov", axis, case="claim", time=Quantity(time, "s"))
        for axis, time in zip(("gyro_x", "accel_x"), seconds, strict=True)
    ]
    assert text in short_legend(replace(calibration, recording_remarks=ends))
