"""Noise processes and their sums: autocovariance, wavelet variance, spectrum and state space, without data."""
