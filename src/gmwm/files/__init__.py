"""From a file to a recording: formats, clocks, columns, units; and noise from datasheets and other programs."""
