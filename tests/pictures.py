"""Coarser pictures: imported by processes that run tests, where the resolution for print takes half of the time.

No test asks for a number of pixels.
"""

from gmwm.showing.plots import matplotlib

matplotlib.PRINT_DPI = 120
