"""From a recording to numbers for models: wavelet variance and its covariance, spectrum, inspection, regression."""
