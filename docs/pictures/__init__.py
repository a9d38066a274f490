"""The pictures of the documentation, all of them written by one command: `python -m docs.pictures`."""
