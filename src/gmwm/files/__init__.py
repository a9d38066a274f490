"""From a file to a recording: formats, clocks, columns and units; and noise from datasheets and files of other
programs."""
