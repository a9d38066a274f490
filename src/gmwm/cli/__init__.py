"""The command line of gmwm. Commands call only public functions, so Python can do everything that a command does."""


def start() -> None:
    """Import the commands and run the script `gmwm`; Ctrl-C during imports ends it without a traceback."""
    import gc
    import os
    import signal

    # The products here are small, or sums over long recordings: the threads of OpenBLAS only wait for each other, 14 %
    # of the CPU time of `gmwm calibrate`, and the last digit of a sum would depend on their number.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    handler = signal.getsignal(signal.SIGINT)
    if handler is signal.default_int_handler:  # otherwise the caller has set it to be ignored
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from gmwm.base.helpers import spare_garbage_collector
    from gmwm.base.threads import share_memory

    spare_garbage_collector()
    share_memory()
    from gmwm.cli.main import run

    try:
        run(handler)
    finally:
        gc.freeze()  # no search for cycles among all objects when the process ends, which takes 0.14 s after a report
