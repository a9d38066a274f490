"""Export for DLIO: the biases of the IMU in dlio.yaml."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gmwm.base.errors import DataError
from gmwm.base.remarks import Remark
from gmwm.showing.exporters.base import Exporter, ExportOptions, register, top
from gmwm.showing.exporters.biases import known_axes, stated, three, unknown
from gmwm.showing.exporters.text import cautions, laid_out, paragraphs, recording, written

if TYPE_CHECKING:
    from gmwm.calibration import Calibration


@register
class Dlio(Exporter):
    """File for DLIO with the biases at rest.

    DLIO has no noise parameters. It subtracts the biases: corrected = sm · raw − bias, with sm the scale matrix.

    Source: `cfg/dlio.yaml` and `odom.cc` of direct_lidar_inertial_odometry.
    """

    name = "dlio"
    title = "DLIO (dlio.yaml)"
    extension = ".yaml"

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the YAML file with the intrinsic parameters of the IMU."""
        if not known_axes(calibration.rest, "gyro"):
            raise DataError(
                "dlio needs the biases of the gyroscopes, but this calibration has none",
                advice="Calibrate a recording with gyroscopes, and not a wavelet variance.",
            )
        notes = [
            recording(calibration),
            *paragraphs(self.remarks(calibration, options)),
            "Units: biases at rest, accelerometers m/s², gyroscopes rad/s, in the order x, y, z. DLIO has no "
            "parameters for N and K. Inflation factor: none. Horizon: none.",
            *stated(calibration, ("gyro", "accel")),
            "With calibration: false, DLIO starts with these biases. With true, it estimates them in its first seconds "
            "and ignores them. Keep sm of your file if you have calibrated scale factors.",
        ]
        lines = ["dlio:", "  imu:", "    calibration: false", "    intrinsics:"]
        for key, quantity, extra in (("accel", "accel", True), ("gyro", "gyro", False)):
            values = three(calibration.rest, "accel" if quantity == "accel" else "gyro")
            lines += [f"      {key}:", f"        bias: [{', '.join(map(written, values))}]"]
            lines += ["        sm: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]"] if extra else []
        return laid_out(top(self, calibration), lines, notes, "#")

    def remarks(self, calibration: Calibration, options: ExportOptions) -> tuple[Remark, ...]:
        """Return cautions of the calibration, and remarks on axes whose bias is not known."""
        return (*cautions(calibration), *unknown(calibration, ("gyro", "accel")))
