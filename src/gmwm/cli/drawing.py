"""Import Matplotlib for commands, without the properties in the docstrings of its classes: 0.08 of 0.3 s."""

from importlib import import_module

import matplotlib.artist

matplotlib.artist.kwdoc = lambda artist: ""
for _module in ("imu", "matplotlib"):
    import_module(f"gmwm.showing.plots.{_module}")
