"""From a recording to numbers that models are fitted to: wavelet variance and its covariance, spectrum,
inspection, regression."""
