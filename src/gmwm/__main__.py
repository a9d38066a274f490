"""Run the command line with `python -m gmwm`."""

from gmwm.cli.main import run

if __name__ == "__main__":
    run()
