"""The columns of a recording: which column is which axis, in which unit, and with which scale factor."""
