"""Modal identification of ring-downs.

`identify_ring_down`
    Any sampled ring-down, number of modes unknown: ERA over many orders, stabilisation, maximum likelihood.
`identify_free_decays`
    Many free decays of one structure with a known number of modes, each separately, by maximum likelihood; fast.
`identify_impacts`
    Whole taps of the tester: noise model, end of the pulse and the recorder's filter included.
`hankel_svd`, `realise`
    The Eigensystem Realization Algorithm itself, with indicators and uncertainties.
`fit_exponentials`
    Least squares with damped exponentials from given starting poles.
`along_the_decay`
    Frequency and damping of a mode against its amplitude.
`spectral_mode`
    A mode from spectra alone, as a check.
"""

from analysis.modal.amplitude import along_the_decay
from analysis.modal.era import hankel_svd, realise
from analysis.modal.exponentials import FitFailure, fit_exponentials
from analysis.modal.free_decay import identify_free_decays
from analysis.modal.identify import identify_ring_down
from analysis.modal.spectrum import spectral_mode
from analysis.modal.tester import identify_impacts

__all__ = [
    "FitFailure",
    "along_the_decay",
    "fit_exponentials",
    "hankel_svd",
    "identify_free_decays",
    "identify_impacts",
    "identify_ring_down",
    "realise",
    "spectral_mode",
]
