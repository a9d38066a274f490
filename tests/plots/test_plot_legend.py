"""Legends and titles: always inside the picture, which grows with them."""

import warnings

import pytest
from matplotlib.figure import Figure as MatplotlibFigure

import gmwm
from gmwm.showing.plots import plot_comparison, plot_fit, plot_imu, plot_plan
from gmwm.showing.plots.matplotlib import fold, width_of
from gmwm.theory.processes.oscillator import name_in_text
from tests.helpers import each

LONG = "a recording with a name that is much longer than any legend of one line can hold on a page of a journal"


def fitted(model, wv):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gmwm.errors.FitWarning)
        return gmwm.fit(model, wv)


@pytest.fixture(scope="module")
def many(wv):
    values = "beta={}, sigma2=1e-9"
    gm = " + ".join(f"GM({values.format(beta)})" for beta in (50.0, 0.5, 0.01))
    lines = "SIN(frequency=0.7, power=3e-8) + SIN(frequency=60, power=5e-8)"
    model = gmwm.Model.parse(f"{gm} + WN(sigma2=7e-7) + QN(q2=2e-6) + RW(gamma2=1e-13) + {lines}")
    exact = gmwm.WaveletVariance.from_values(model.wavelet_variance(20, 250.0), 3_000_000, 250.0, unit="rad/s")
    return fitted("3*GM + WN + QN + RW + 2*SIN", exact)


def assert_inside(picture, dpi=400):
    """At the resolution of a file too, where letters have other widths."""
    picture.set_dpi(dpi)
    picture.draw_without_rendering()
    (legend,) = picture.legends
    parts = [legend, *legend.get_texts(), *(axes.title for axes in picture.axes if axes.get_title())]
    for box in (part.get_window_extent() for part in parts):
        assert 0 < box.x0 <= box.x1 < picture.bbox.width
        assert 0 <= box.y0 <= box.y1 < picture.bbox.height
    return legend


def height_of_panel(picture):
    return picture.axes[0].get_window_extent().height / picture.dpi


@pytest.mark.slow
@pytest.mark.parametrize(("view", "units"), [("wavelet", "si"), ("allan", "datasheet")])
def test_many_terms(many, view, units):
    legend = assert_inside(plot_fit(many, view=view, units=units))
    assert {text.get_text().split(":")[0] for text in legend.get_texts()} >= {
        name_in_text(term, process) for term, process in zip(many.model.terms, many.model.processes, strict=True)
    }
    assert_inside(plot_imu({"gyro_x": many, "gyro_y": many}, view=view, units=units))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["SARMA(1,0,1,0,12) + WN + GM", "AR(5) + WN"])
def test_long_terms_leave_the_panel_its_height(fit, wv, name):
    long = gmwm.Model.parse(
        "SARMA(phi=[0.5], sphi=[0.3], period=12, sigma2=1e-7) + AR(phi=[0.2, 0.1], sigma2=1e-9) + WN(sigma2=1e-7)"
    )
    exact = gmwm.WaveletVariance.from_values(long.wavelet_variance(18, 250.0), 1_000_000, 250.0)
    picture = plot_fit(fitted(name, exact))
    assert_inside(picture)
    usual = plot_fit(fit)
    assert_inside(usual)
    assert height_of_panel(picture) > 0.9 * height_of_panel(usual)


@pytest.mark.slow
def test_names_longer_than_the_page_are_folded_and_the_picture_grows(wv, tmp_path):
    short, long = (
        plot_comparison({f"{name} {k}": wv for k in range(5)}, title=name, path=tmp_path / f"{n}.{ending}")
        for n, (name, ending) in enumerate((("a", "pdf"), (LONG, "svg")))
    )
    legend = assert_inside(long)
    assert_inside(short)
    assert [t.get_text().replace("\n", " ") for t in legend.get_texts()][:5] == [f"{LONG} {k}" for k in range(5)]
    assert long.get_figheight() > short.get_figheight()
    assert height_of_panel(long) > 0.85 * height_of_panel(short)
    assert_inside(plot_imu({"gyro_x": {LONG: wv, "b": wv}, "gyro_y": wv}))


@pytest.mark.slow
def test_a_plan_of_many_parameters():
    plan = gmwm.plan(
        "GM(beta=8.0, sigma2=1e-6) + GM(beta=0.8, sigma2=1e-6) + GM(beta=0.08, sigma2=1e-6) + WN(sigma2=4e-6)"
        " + QN(q2=1e-6) + RW(gamma2=4e-10)", duration=60.0, rate=100.0,
    )  # fmt: skip
    assert_inside(plot_plan(plan))


@pytest.mark.slow
def test_a_legend_in_narrow_axes_is_folded(many):
    mine = MatplotlibFigure(figsize=(5, 3))
    axes = mine.subplots(1, 2)
    plot_fit(many, ax=axes[0])
    mine.draw_without_rendering()
    assert axes[0].get_legend().get_window_extent().width <= axes[0].bbox.width


@pytest.mark.slow
@each("room", [30.0, 60.0, 120.0, 400.0])
@each("text", [LONG, "GM[1]: T = 17 ms, σ = 3.6×10⁻⁴ rad/s (like WN)", "x" * 90, "", "a\nb"])
def test_folded_lines_fit_and_lose_nothing(text, room):
    lines = fold(text, room, 6.6).split("\n")
    assert max(width_of(line, 6.6) for line in lines) <= max(room, 6 * 6.6)
    assert "".join(lines).replace(" ", "") == text.replace(" ", "").replace("\n", "")
    assert len(lines) == 1 or all(lines)
