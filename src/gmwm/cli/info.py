"""gmwm info: what a file holds, as it was understood."""

from __future__ import annotations

from gmwm.cli.options import File, Json, Opening, load, opens

EXAMPLES = ("gmwm info static.csv", "gmwm info log.txt --rate 100 --units gyro=deg/s,accel=g")


@opens
def info(
    file: File,
    opening: Opening,
    json: Json = False,
) -> None:
    """Say what a recording holds and whether it can be used.

    Rate and duration, gaps and jitter of the time stamps, axes and units as understood, the least significant
    bit, whether the unit stood still, knocks and steps, temperature, and what to beware of.

    In the table, all in SI units: mean; sd, the standard deviation of all samples; noise, that of white noise with
    the same differences from sample to sample, which offset and slow drift do not reach; LSB, the quantisation step
    where one shows; wander, the largest difference between the means of 64 equal pieces of the recording.
    """
    from gmwm.cli.errors import as_options
    from gmwm.cli.output import print_json, progress, tell, told_warnings
    from gmwm.inspection import inspect

    with told_warnings() as told:
        imu = load(file, opening)
        with progress("inspecting"):
            inspection = inspect(imu)
        if json:
            for warning in inspection.warnings:
                tell(told, warning)
            print_json("info", {"file": str(file), **inspection.to_dict()}, told)
        else:
            print(as_options(inspection.summary()))
