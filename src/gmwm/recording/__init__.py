"""Samples with a clock: signals and recordings, in memory or in chunks, their gaps, time ranges and options."""
