"""PNG files: the pixels that Matplotlib writes, its figure as it was, and the resolution."""

import io

import numpy as np
import pytest
from PIL import Image

from gmwm import calibrate, simulate
from gmwm.showing.plots import matplotlib as renderer
from gmwm.showing.plots.png import encoded, png


@pytest.fixture(scope="module")
def found():
    truth = dict.fromkeys(("gyro_x", "gyro_y", "accel_z"), "WN(sigma2=4e-7) + RW(gamma2=1e-11)")
    return calibrate(simulate(truth, rate=100.0, samples=4000, rng=1), within="WN + RW")


@pytest.mark.parametrize("options", [{}, {"split": False}, {"view": "allan", "units": "datasheet"}])
def test_the_pixels_are_those_of_matplotlib(found, options):
    picture, expected = found.plot(**options), io.BytesIO()
    found.plot(**options).savefig(expected, dpi=120)
    before = picture.canvas, picture.dpi
    with Image.open(io.BytesIO(png(picture, 120))) as image, Image.open(expected) as other:
        np.testing.assert_array_equal(np.asarray(image), np.asarray(other)[..., :3])
        assert image.info["dpi"] == pytest.approx((120, 120), rel=1e-3)
    assert (picture.canvas, picture.dpi) == before


def test_a_transparent_background_stays_so(found):
    picture = found.plot()
    picture.set_facecolor("none")
    with Image.open(io.BytesIO(renderer.rendered(picture, ".png"))) as image:
        assert image.mode == "RGBA"
        assert image.getpixel((0, 0))[3] == 0


def test_any_pixels_come_back():
    pixels = np.random.default_rng(1).integers(0, 256, (7, 5, 3), dtype=np.uint8)
    with Image.open(io.BytesIO(encoded(pixels, 100))) as image:
        np.testing.assert_array_equal(np.asarray(image), pixels)
