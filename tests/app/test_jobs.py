"""Jobs: results, errors, progress, and cancellation that does not wait for the work."""

import re
import threading
import time

from gmwm.applications.app.workspace import Cancelled, Jobs


def test_a_result_is_made_once():
    jobs, calls = Jobs(), []

    def work(job):
        calls.append(1)
        return 7

    for _ in range(3):
        job = jobs.ask("kind", "key", "Working", work)
        assert job.join(5)
        assert (job.state, job.value) == ("done", 7)
    assert calls == [1]
    assert jobs.revision == 1


def test_an_error_is_kept_until_it_is_tried_again():
    jobs = Jobs()

    def work(job):
        raise ValueError("no")

    job = jobs.ask("kind", "key", "Working", work)
    assert job.join(5)
    assert (job.state, str(job.error)) == ("failed", "no")
    assert jobs.ask("kind", "key", "Working", work) is job
    jobs.again()
    assert jobs.ask("kind", "key", "Working", work) is not job


def test_a_cancelled_job_ends_at_once_and_its_work_at_its_next_step():
    jobs, go, ended = Jobs(), threading.Event(), threading.Event()

    def work(job):
        try:
            go.wait(5)
            job.step("next", 1, 2)
        finally:
            ended.set()

    job = jobs.ask("kind", "key", "Working", work)
    assert [one.title for one in jobs.running()] == ["Working"]
    jobs.cancel()
    assert job.state == "cancelled"
    assert jobs.running() == []
    assert not ended.is_set()
    go.set()
    assert ended.wait(5)
    assert job.state == "cancelled"
    assert job.value is None


def test_a_new_job_replaces_the_running_one_of_its_kind():
    jobs, go = Jobs(), threading.Event()
    first = jobs.ask("kind", 1, "First", lambda job: go.wait(5))
    other = jobs.ask("other", 1, "Other", lambda job: go.wait(5))
    second = jobs.ask("kind", 2, "Second", lambda job: 2)
    assert second.join(5)
    assert (first.state, second.state, other.state) == ("cancelled", "done", "running")
    go.set()


def test_old_results_are_forgotten():
    jobs = Jobs()
    made = [jobs.ask("kind", k, "Working", lambda job: 0, kept=2) for k in range(4)]
    assert all(job.join(5) for job in made)
    assert jobs.ask("kind", 3, "Working", lambda job: 0, kept=2) is made[3]
    assert jobs.ask("kind", 0, "Working", lambda job: 0, kept=2) is not made[0]


def test_a_job_that_waits_for_another_one_shares_its_end():
    jobs, go = Jobs(), threading.Event()

    def slow(job):
        job.step("half", 1, 2)
        go.wait(60)
        job.step("end")
        return 3

    first = jobs.ask("first", 0, "First", slow)
    second = jobs.ask("second", 0, "Second", lambda job: 2 * first.result_for(job))
    while second.text != "First: half":
        time.sleep(0.01)
    assert second.state == "running"
    go.set()
    assert second.join(60)
    assert second.value == 6
    cancelled = jobs.ask("first", 1, "First", lambda job: time.sleep(0.3))
    waiting = jobs.ask("second", 1, "Second", lambda job: cancelled.result_for(job))
    cancelled.cancel()
    assert waiting.join(60)
    assert waiting.state == "cancelled"


def test_a_cancellation_passes_handlers_of_errors():
    handled = []

    def work(job):
        job.cancel()
        try:
            job.step("next")
        except Exception as error:
            handled.append(error)

    job = Jobs().ask("kind", 0, "Working", work)
    assert job.join(5)
    assert (job.state, handled) == ("cancelled", [])
    assert not issubclass(Cancelled, Exception)


def test_the_progress_names_the_step_and_the_time():
    go = threading.Event()

    def work(job):
        job.step("gyro_y", 1, 6)
        go.wait(10)

    job = Jobs().ask("calibration", 1, "Calibrating", work)
    while not job.text:
        time.sleep(0.01)
    assert re.fullmatch(r"Calibrating gyro_y, \d+ s", job.progress)
    go.set()
    assert job.join(10)
