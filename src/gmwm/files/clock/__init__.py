"""The clock of a recording, from its time stamps: sampling rate, gaps, lost samples and irregularities."""
