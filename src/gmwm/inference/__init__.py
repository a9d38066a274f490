"""Inference: standard errors, confidence intervals, tests, bootstrap, criteria and planning."""
