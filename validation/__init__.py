"""Statistical studies: is what the package reports true? Run by `make validate`, or `python -m validation`."""
