"""Run a command for each recording in a file that contains several, such as a ROS bag."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from gmwm.base.errors import DataError, GmwmError, OptionError
from gmwm.base.remarks import Remark
from gmwm.cli.output import Outcome
from gmwm.recording.options import ReadOptions


def each_topic(
    one: Callable[[ReadOptions, Path | None], Outcome], file: Path, reading: ReadOptions, output: Path | None
) -> Outcome:
    """Run a command for each IMU topic of a file, and combine the outcomes into one."""
    from gmwm.files.readers.topics import inertial_topics, topic_folder

    if reading.topic is not None:
        raise OptionError(argument="topic", expected="left out with --all-topics", got=reading.topic)
    done: dict[str, Outcome] = {}
    failed: dict[str, str] = {}
    for topic in inertial_topics(file, reading.format):
        try:
            done[topic] = one(replace(reading, topic=topic), None if output is None else output / topic_folder(topic))
        except GmwmError as error:
            failed[topic] = error.reason
    if not done:
        topic, reason = next(iter(failed.items()))
        raise DataError(f"none of {len(failed)} recordings of {file} can be used; the first one is {topic}: {reason}")
    outcomes = tuple(done.values())
    return Outcome(
        command=outcomes[0].command,
        document={"file": str(file), "topics": {topic: outcome.document for topic, outcome in done.items()}},
        text="\n\n".join(f"Topic {topic}\n{outcome.text}" for topic, outcome in done.items()),
        all_text="\n\n".join(f"Topic {topic}\n{outcome.all_text}" for topic, outcome in done.items()),
        files=tuple(new for outcome in outcomes for new in outcome.files),
        obsolete=tuple(old for outcome in outcomes for old in outcome.obsolete),
        remarks=(
            *(remark for outcome in outcomes for remark in outcome.remarks),
            *(
                Remark.of("not-calibrated", topic, case="calibration", reason=reason)
                for topic, reason in failed.items()
            ),
        ),
    )


def separate_topics(files: Sequence[Path], reading: ReadOptions) -> tuple[str, ...]:
    """Return the topic of the gyroscopes and the topic of the accelerometers if one file has exactly one of each.
    Otherwise the result is empty, and also if there are several files or the user selected a topic or columns."""
    from gmwm.files.readers.topics import separate_sensors

    if len(files) != 1 or reading.topic is not None or reading.columns is not None:
        return ()
    try:
        return separate_sensors(files[0], reading.format) or ()
    except (GmwmError, OSError):
        return ()  # The error is reported later, when the recording is opened.
