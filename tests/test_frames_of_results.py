"""Results as data frames hold the numbers of the results."""

import importlib.util

import numpy as np
import pytest

import gmwm

pytestmark = pytest.mark.filterwarnings("ignore::gmwm.errors.GmwmWarning")
RNG = np.random.default_rng(1)
IMU = gmwm.Imu.from_arrays({"gyro_x": RNG.normal(size=4000), "gyro_y": RNG.normal(size=4000)}, 100.0)


def test_curves():
    curves = gmwm.wavelet_variance(IMU)
    frame = curves.to_polars()
    assert frame.height == sum(map(len, curves.values()))
    assert frame["axis"].unique(maintain_order=True).to_list() == ["gyro_x", "gyro_y"]
    own = curves["gyro_y"].to_polars()
    np.testing.assert_array_equal(own["variance"], curves["gyro_y"].variance)
    np.testing.assert_array_equal(own["tau"], curves["gyro_y"].tau)


def test_fits_and_rankings():
    curve = gmwm.wavelet_variance(IMU["gyro_x"])
    fit = gmwm.fit("WN + RW", curve)
    rows = {row["parameter"]: row for row in fit.to_polars(0.9).to_dicts()}
    limits = fit.confidence_intervals(0.9)
    assert set(rows) == set(fit.parameters)
    for name, (low, high) in limits.items():
        assert (rows[name]["value"], rows[name]["low"], rows[name]["high"]) == (fit.parameters[name], low, high)
    ranking = gmwm.select("WN + RW + QN", curve)
    frame = ranking.to_polars()
    assert frame["model"].to_list() == [one.structure for one in ranking]
    assert frame.filter(frame["recommended"])["model"].to_list() == [ranking.recommended.structure]


@pytest.mark.slow
def test_calibrations():
    calibration = gmwm.calibrate(IMU, within="WN + RW", robust=False)
    frame = calibration.to_polars("si")
    for axis, sheet in calibration.datasheets.items():
        assert frame.filter(frame["axis"] == axis).drop("axis").to_dicts() == sheet.to_polars("si").to_dicts()
    assert "N" in frame["symbol"].to_list()


# --- other libraries ----------------------------------------------------------------------------------


def frames(imu):
    """The recording as a table of each library."""
    pandas = pytest.importorskip("pandas", reason="needs pandas")
    dates = pandas.Timestamp("2026-03-01") + pandas.to_timedelta(imu["gyro_x"].times(), unit="s")
    columns = {axis: imu[axis].values for axis in imu}
    yield imu.to_polars()
    yield imu.to_pandas()
    yield pandas.DataFrame(columns, index=dates)
    if importlib.util.find_spec("xarray"):
        yield imu.to_xarray()


@pytest.mark.slow
def test_functions_take_data_frames():
    curves, inspection = gmwm.wavelet_variance(IMU), gmwm.inspect(IMU)
    for frame in frames(IMU):
        measured = gmwm.wavelet_variance(frame)
        for axis, curve in curves.items():
            np.testing.assert_array_equal(measured[axis].variance, curve.variance)
        assert gmwm.psd(frame)["gyro_x"].rate == pytest.approx(100)
        assert gmwm.inspect(frame).axes["gyro_y"].noise == inspection.axes["gyro_y"].noise


@pytest.mark.slow
def test_a_data_frame_is_calibrated_as_a_recording():
    pytest.importorskip("pandas", reason="needs pandas")
    expected = gmwm.calibrate(IMU, within="WN + RW", robust=False)
    for data in (IMU.to_pandas(), [IMU.to_polars()]):
        calibration = gmwm.calibrate(data, within="WN + RW", robust=False)
        assert calibration["gyro_x"].parameters == expected["gyro_x"].parameters


def test_the_temperature_and_the_units_of_a_recording_come_back():
    imu = gmwm.Imu({"gyro_x": IMU["gyro_x"]}, temperature=np.linspace(20, 30, 4000))
    for frame in frames(imu):
        if "temperature [°C]" in frame or "temperature" in frame:
            np.testing.assert_array_equal(gmwm.Imu.from_arrays(frame).temperature, imu.temperature)


def test_results_are_tables_of_every_library():
    pytest.importorskip("pandas", reason="needs pandas")
    curves = gmwm.wavelet_variance(IMU)
    table = curves.to_pandas().set_index(["axis", "level"])
    assert table.loc[("gyro_y", 3), "variance"] == curves["gyro_y"].variance[2]
    fit = gmwm.fit("WN", curves["gyro_x"])
    assert fit.to_pandas(0.9)["low"][0] == fit.confidence_intervals(0.9)["WN.sigma2"][0]
    pytest.importorskip("xarray", reason="needs xarray")
    data = curves.to_xarray()
    assert dict(data.sizes) == {"axis": 2, "level": curves["gyro_x"].levels.size}
    assert float(data["variance"].sel(axis="gyro_y", level=3)) == curves["gyro_y"].variance[2]


def test_notebooks_show_a_recording_as_a_table():
    html = gmwm.Imu.from_arrays({"gyro_x": [0.0, 1.0] * 8}, 100.0, source="<a>")._repr_html_()
    assert "&lt;a&gt;: 16 samples at 100 Hz" in html
    assert "<td>gyro_x</td><td>0.5</td><td>0.5</td><td>rad/s</td>" in html
