"""The command line. Every command calls public functions only: what it does can be done in Python too."""
