"""From the sources to files that install where there is no compiler: `make wheel`."""
