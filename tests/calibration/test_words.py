"""The summary says what a person can act on, in eighty columns; the pictures show every axis."""

import re
from dataclasses import replace

import pytest

import gmwm
from gmwm._text import rounded
from gmwm.calibration.summary_text import cautions
from gmwm.calibration.tables import in_order, merged
from gmwm.plots.imu import imu_figure

from .conftest import WITHIN


def words(calibration):
    return " ".join(calibration.summary().split())


def test_it_fits_eighty_columns(calibration):
    assert max(map(len, calibration.summary().splitlines())) <= 80


def test_wide_tables_are_cut_to_fewer_axes(calibration):
    found = calibration.axes["gyro_x"]
    long = {f"gyro_{'turned_' * 3}{letter}": found for letter in "xyz"}
    text = replace(calibration, axes=long, cautions=()).summary()
    assert max(map(len, text.splitlines())) <= 80
    assert text.count("p of the fit") == 2
    assert all(name in text for name in long)


def test_each_sensor_has_its_table(calibration):
    text = calibration.summary()
    gyro, accel = text.index("Gyroscopes"), text.index("Accelerometers")
    assert gyro < text.index("gyro_x") < text.index("gyro_y") < accel < text.index("accel_x")
    assert "knocked.csv" in text
    for axis, fit in calibration.items():
        assert fit.model.structure.replace(" ", "") in text
        assert calibration.axes[axis].test.pvalue_in_words in text


def test_numbers_are_those_of_the_datasheets(calibration):
    text = calibration.summary()
    for sheet in calibration.datasheets.values():
        for symbol, entry in sheet.items():
            value, low, high, unit = entry.in_units("datasheet")
            if entry.upper_only:
                assert f"≤ {high:.3g}" in text
            elif (high - low) / 2 <= 0.5 * abs(value):
                assert f"{value:.3g} ± {100 * (high - low) / 2 / abs(value):.2g} %" in text
            else:
                assert f"{low:.2g} … {high:.2g}" in text
            assert f"{symbol} ({unit})" in text
            assert f"{symbol} {entry.title}" in words(calibration)


def test_outliers_are_told_with_their_size(calibration):
    text = words(calibration)
    verdict = calibration.verdicts["gyro_y"]
    assert f"{100 * verdict.excess[verdict.exceeding].max():.0f} %" in text
    assert "The robust curve was fitted" in text
    kept = replace(calibration, axes={**calibration.axes, "gyro_y": replace(calibration.axes["gyro_y"])})
    assert words(kept) == text


def test_outliers_that_were_kept_are_told_too(imu):
    text = words(gmwm.calibrate(imu, WITHIN, robust=False, axes=["gyro_y"]))
    assert "it was fitted with them; the robust curve leaves them out" in text
    assert "yes: kept" in text


def test_cautions_of_the_recording_are_told(imu, calibration):
    (knocks,) = [text for text in gmwm.inspect(imu).warnings if "knock" in text]
    robust = ", or leave that to the robust curve, which calibrate takes by itself where it matters"
    assert knocks.endswith(f"cut them out (skip=), or record again{robust}")
    found, *others = calibration.cautions
    assert len(others) == len(gmwm.inspect(imu).warnings) - 1
    # Robust estimates have been made already where they matter.
    assert found == knocks.replace(robust, "; where outliers matter, the robust curve was taken")
    assert all(" ".join(caution.split()) in words(calibration) for caution in calibration.cautions)


@pytest.mark.parametrize(
    ("robust", "end"),
    [(True, "; the robust curve was taken"), (False, "or take the robust curve, which leaves them out")],
)
def test_what_to_do_with_knocks_hangs_on_what_was_done(imu, robust, end):
    (found,) = [text for text in cautions(gmwm.inspect(imu).warnings, robust) if "knock" in text]
    assert found.endswith(end)


def test_a_drift_is_told():
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7) + DR(omega=-2e-8)"}, rate=100.0, samples=100_000, rng=1)
    found = gmwm.calibrate(imu, "WN + RW + DR")
    value, _, _, unit = found.datasheets["gyro_x"]["R"].in_units("datasheet")
    assert value < 0
    assert f"the output drifts: gyro_x by {rounded(value)} {unit}." in words(found)


def test_a_rejected_model_is_told(calibration):
    assert "the test rejects" not in words(calibration)
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=2e-11)"}, rate=100.0, samples=100_000, rng=4)
    assert "gyro_x: the test rejects even the recommended model" in words(gmwm.calibrate(imu, "WN"))


def test_the_usable_scale_is_told(calibration):
    assert "17 min of recording show scales up to 2.7 min well" in words(calibration)


def test_a_note_of_several_axes_is_told_once(calibration):
    axes = {axis: replace(found, notes=("one thing",)) for axis, found in calibration.axes.items()}
    assert "- gyro_x, gyro_y, accel_x: one thing" in replace(calibration, axes=axes).summary()


def test_rows_keep_the_order_of_every_axis():
    assert merged([["N", "B"], ["Q", "N", "K"], ["N", "B", "K", "T_c"]]) == ["Q", "N", "B", "K", "T_c"]
    assert merged([["N", "T_c[1]"], ["N", "B", "T_c[1]", "T_c[2]"]]) == ["N", "B", "T_c[1]", "T_c[2]"]


def test_symbols_of_the_standard_come_in_its_order():
    lists = [["N", "B", "R", "T_c[1]"], ["N", "B", "K", "T_c[1]", "T_c[2]"], ["Q", "N"]]
    assert in_order(lists) == ["Q", "N", "B", "K", "R", "T_c[1]", "T_c[2]"]


def test_one_gauss_markov_term_stands_beside_the_first_of_two():
    truth = {
        "gyro_x": "GM(beta=8.0, sigma2=5e-8) + GM(beta=0.2, sigma2=2e-8) + WN(sigma2=4e-7)",
        "gyro_y": "GM(beta=2.0, sigma2=5e-8) + WN(sigma2=4e-7)",
    }
    found = gmwm.calibrate(gmwm.simulate(truth, rate=100.0, samples=200_000, rng=2), "2*GM + WN")
    assert [fit.model.structure for fit in found.values()] == ["2*GM + WN", "GM + WN"]
    rows = [line for line in found.summary().splitlines() if line.startswith("  T_c")]
    assert [row.split()[0] for row in rows] == ["T_c[1]", "T_c[2]"]
    assert rows[0].count("±") == 2


@pytest.mark.parametrize("split", [True, False])
def test_the_pictures_show_every_axis(calibration, split, tmp_path):
    figure = imu_figure(calibration, split=split)
    panels = [panel for row in figure.rows for panel in row if panel is not None]
    assert len(panels) == (3 if split else 2)
    calibration.plot(split=split, path=tmp_path / "calibration.png")
    assert (tmp_path / "calibration.png").read_bytes().startswith(b"\x89PNG")


def test_it_is_short_in_a_list_and_whole_in_a_notebook(calibration):
    assert repr(calibration).startswith("Calibration(gyro_x: ")
    assert "Gyroscopes" in calibration._repr_html_()


def test_scales_that_gaps_hide_are_told(imu):
    x = imu["gyro_x"]
    pieces = tuple((start, min(start + 2000, 100_000)) for start in range(0, 100_000, 2000))
    # A sample is lost every 20 s.
    starts = tuple((start + k) / 100.0 for k, (start, _) in enumerate(pieces))
    gappy = gmwm.Signal(x.values, 100.0, "rad/s", "gyro_x", segments=pieces, starts=starts)
    whole, apart = (words(gmwm.calibrate({"gyro_x": signal}, "GM + WN")) for signal in (x, gappy))
    (scale,) = re.findall(r"show scales up to ([\d.]+ \w+) well; what changes more slowly", whole)
    assert f"Without its gaps it would show scales up to {scale}: a fit by maximum likelihood sees across" in apart
    assert "Without its gaps" not in whole
