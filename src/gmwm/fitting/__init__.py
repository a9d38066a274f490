"""A model against measured numbers: estimates, errors, intervals, tests, and maximum likelihood."""
