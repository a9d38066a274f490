"""`gmwm app`: calibrate a recording in the browser, on your own machine.

A `Session` holds every choice of the user and is a small JSON document. A `Workspace` computes the results of a
session with public functions of gmwm. `page` shows them, and `server` serves the page on 127.0.0.1. Only `page` and
`server` need the extra `app`.
"""
