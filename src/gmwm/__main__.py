"""Run the command line with `python -m gmwm`."""

from gmwm.cli import start

if __name__ == "__main__":
    start()
