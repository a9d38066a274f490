"""`python -m gmwm` is `gmwm`."""

from gmwm.cli.main import run

if __name__ == "__main__":
    run()
