"""Write the golden files anew: `python -m tests.exporters.make_golden`; look at the difference before it is kept."""

from .conftest import TRUTHS, as_golden, calibrated
from .consumers import CONSUMERS
from .test_consumers import GOLDEN

if __name__ == "__main__":
    for name, truths in TRUTHS.items():
        calibration = calibrated(truths)
        (GOLDEN / name).mkdir(parents=True, exist_ok=True)
        for format in sorted({*CONSUMERS, "autoware", "ros", "csv", "latex"}):
            (GOLDEN / name / f"{format}.txt").write_text(as_golden(calibration, format), encoding="utf-8")
