"""Citations of gmwm for reports, with the same content as CITATION.cff."""

from __future__ import annotations

from gmwm.base.text import version

METHOD = (
    "J. Balamuta, S. Guerrier, R. Molinari and W. Yang, A Computationally Efficient Framework for Automatic Inertial "
    "Sensor Calibration, IEEE Sensors Journal, 2018 (preprint arXiv:1603.05297)."
)
"""The paper that describes the method."""

_BIBTEX = """@software{{gmwm,
  title = {{gmwm: Stochastic calibration of inertial sensors by the Generalized Method of Wavelet Moments}},
  author = {{{{the gmwm developers}}}},
  version = {{{version}}},
  license = {{BSD-3-Clause}}
}}

@article{{balamuta2018,
  title = {{A Computationally Efficient Framework for Automatic Inertial Sensor Calibration}},
  author = {{Balamuta, James and Guerrier, Stéphane and Molinari, Roberto and Yang, Wenchao}},
  journal = {{IEEE Sensors Journal}},
  year = {{2018}},
  note = {{arXiv:1603.05297}}
}}"""


def citation() -> dict[str, str]:
    """Return the citations of the software and of the method as text, and both as BibTeX."""
    software = (
        f"The gmwm developers, gmwm: Stochastic calibration of inertial sensors by the Generalized Method of Wavelet "
        f"Moments, version {version()}."
    )
    return {"software": software, "method": METHOD, "bibtex": _BIBTEX.format(version=version())}
