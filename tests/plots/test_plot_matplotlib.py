import subprocess
import sys

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure as MatplotlibFigure

from gmwm.base.errors import OptionError
from gmwm.showing.plots import plot_comparison, plot_fit, plot_imu, plot_wavelet_variance
from gmwm.showing.plots.figure import Figure, description
from gmwm.showing.plots.fit import fit_panel
from gmwm.showing.plots.matplotlib import draw
from tests.helpers import raises


def drawn(axes):
    """Every curve on Matplotlib axes, by its label."""
    return {line.get_label(): line for line in axes.get_lines()}


@pytest.mark.parametrize("view", ["wavelet", "allan"])
@pytest.mark.parametrize("units", ["si", "datasheet"])
def test_every_mark_is_drawn_with_its_numbers(fit, view, units):
    panel = fit_panel(fit, view=view, units=units)
    (axes,) = draw(Figure(((panel,),))).axes
    lines = drawn(axes)
    for line in panel.lines:
        np.testing.assert_array_equal(lines[line.label].get_xdata(), line.x)
        np.testing.assert_array_equal(lines[line.label].get_ydata(), line.y)
    fills = [c for c in axes.collections if c.get_label() in {band.label for band in panel.bands}]
    assert len(fills) == len(panel.bands)
    assert axes.get_xlabel() == panel.x.label
    assert axes.get_ylabel() == panel.y.label
    np.testing.assert_allclose(axes.get_xlim(), panel.x.limits)
    np.testing.assert_allclose(axes.get_ylim(), panel.y.limits)


def test_the_ticks_are_those_of_the_data(fit):
    panel = fit_panel(fit)
    picture = draw(Figure(((panel,),)))
    picture.canvas.draw()
    (axes,) = picture.axes
    assert [text.get_text() for text in axes.get_yticklabels()] == [tick.label for tick in panel.y.ticks]
    assert [text.get_text() for text in axes.get_xticklabels()] == [tick.label for tick in panel.x.ticks]
    (upper,) = axes.child_axes
    assert [text.get_text() for text in upper.get_xticklabels()] == [t.label for t in panel.x.opposite]


def test_one_legend_names_everything_once(wv, fit):
    axes = {"gyro_x": fit, "gyro_y": wv}
    picture = plot_imu(axes)
    (legend,) = picture.legends
    assert [text.get_text() for text in legend.get_texts()] == list(description(plot_imu)(axes).labels)


def test_the_swatch_of_several_bands_is_in_the_colour_of_none(wv):
    picture = plot_comparison({"one": wv, "other": wv})
    (legend,) = picture.legends
    at = [text.get_text() for text in legend.get_texts()].index("95 % limits, any noise")
    red, green, blue, _ = legend.legend_handles[at].get_facecolor()
    assert red == green == blue


def test_the_legend_is_never_wider_than_the_picture(wv):
    names = [f"a recording with quite a long name, number {k}" for k in range(6)]
    picture = plot_comparison(dict.fromkeys(names, wv))
    assert picture.legends[0].get_window_extent().width <= picture.bbox.width
    assert len(picture.legends) == 1


def test_nothing_overlaps_the_border(fit):
    picture = plot_fit(fit)
    picture.canvas.draw()
    boxes = [axes.get_tightbbox() for axes in picture.axes] + [picture.legends[0].get_window_extent()]
    for box in boxes:
        assert box.x0 >= -1
        assert box.y0 >= -1
        assert box.x1 <= picture.bbox.width + 1
        assert box.y1 <= picture.bbox.height + 1


def test_a_panel_that_is_measured_once_has_the_place_of_the_full_layout(fit):
    picture = plot_imu({"gyro_x": fit, "gyro_y": fit})
    picture.canvas.draw()
    places = [axes.bbox.extents for axes in picture.axes]
    picture.set_layout_engine("constrained")
    picture.canvas.draw()
    for place, axes in zip(places, picture.axes, strict=True):
        np.testing.assert_allclose(place, axes.bbox.extents, atol=2.5 * picture.dpi / 300)  # 0.2 mm


def test_zeros_and_a_lone_interval_are_drawn(wv, scaled):
    values = wv.variance.copy()
    values[[0, 2]] = 0.0
    picture = plot_wavelet_variance(scaled(wv, variance=values), view="wavelet")
    (axes,) = picture.axes
    np.testing.assert_array_equal(drawn(axes)["Zero at 2 of 20 scales"].get_xdata(), wv.tau[[0, 2]])
    bars = [c for c in axes.collections if len(c.get_paths()) == 1 and c.get_linewidth()[0] == 4.0]
    assert len(bars) == 1


def test_a_constant_signal_can_be_drawn(wv, scaled):
    picture = plot_wavelet_variance(scaled(wv, variance=np.zeros(4)))
    assert "Every variance is zero" in [text.get_text() for text in picture.axes[0].texts]


@pytest.mark.slow
def test_unbounded_and_zero_limits_can_be_drawn(wv, tmp_path):
    from dataclasses import replace

    open_ended = replace(wv, lower=np.zeros(20), upper=np.full(20, np.inf))
    plot_wavelet_variance(open_ended, path=tmp_path / "open.png")


@pytest.mark.slow
@pytest.mark.parametrize(("ending", "start"), [(".png", b"\x89PNG"), (".pdf", b"%PDF"), (".svg", b"<?xml")])
def test_files_are_written_and_repeatable(wv, tmp_path, ending, start):
    for name in ("one", "two"):
        plot_wavelet_variance(wv, path=tmp_path / f"{name}{ending}")
    one, two = ((tmp_path / f"{name}{ending}").read_bytes() for name in ("one", "two"))
    assert one.startswith(start)
    assert one == two
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"one{ending}", f"two{ending}"]


def test_an_unknown_ending_writes_nothing(wv, tmp_path):
    with raises(OptionError, ".png, .pdf, .svg", argument="path", got=str(tmp_path / "curve.jpeg")):
        plot_wavelet_variance(wv, path=tmp_path / "curve.jpeg")
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_leaves_the_old_file(wv, tmp_path, monkeypatch):
    path = tmp_path / "curve.png"
    path.write_bytes(b"old")

    def fail(*args, **kwargs):
        raise OSError("disk full")

    monkeypatch.setattr(MatplotlibFigure, "draw", fail)
    with pytest.raises(OSError, match="disk full"):
        plot_wavelet_variance(wv, path=path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_on_axes_of_the_caller(wv, fit):
    mine = MatplotlibFigure()
    axes = mine.subplots(1, 2)
    assert plot_wavelet_variance(wv, ax=axes[0]) is mine
    assert plot_fit(fit, ax=axes[1]) is mine
    assert [text.get_text() for text in axes[0].get_legend().get_texts()] == [
        "Allan deviation",
        "95 % limits, any noise",
    ]
    inner = MatplotlibFigure()
    assert plot_wavelet_variance(wv, ax=inner.subfigures(1, 2)[1].add_subplot()) is inner
    with raises(OptionError, argument="ax", got="here", advises=["add_subplot"]):
        plot_wavelet_variance(wv, ax="here")


@pytest.mark.slow
def test_a_picture_shows_itself_in_a_notebook(wv):
    assert plot_wavelet_variance(wv)._repr_png_().startswith(b"\x89PNG")


@pytest.mark.slow
def test_no_global_state(wv, tmp_path):
    before = dict(matplotlib.rcParams)
    plot_wavelet_variance(wv, path=tmp_path / "curve.svg")
    assert dict(matplotlib.rcParams) == before


def test_results_draw_themselves(wv, fit):
    assert wv.plot().axes[0].get_ylabel() == "Allan deviation (deg/h)"
    axes = fit.plot(units="datasheet").axes[0]
    lines = [line for line in axes.get_lines() if line.get_transform() == axes.transData]
    assert len(lines) == 2 + len(fit.decomposition)


@pytest.mark.slow
def test_matplotlib_is_imported_when_something_is_drawn():
    code = "import sys, gmwm.plots; sys.exit(any(m.partition('.')[0] == 'matplotlib' for m in sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.slow
def test_pyplot_is_never_imported():
    code = (
        "import sys; from gmwm.measuring.variance.result import WaveletVariance as W;"
        "W.from_values([3., 2., 1.], 100, 10.).plot(); sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
