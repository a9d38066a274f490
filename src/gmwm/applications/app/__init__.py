"""`gmwm app`: calibrate a recording in the browser, on your own machine.

A `Session` contains all choices of the user and can be saved as a small JSON document. A `Workspace` computes the
results of a session with public functions of gmwm. The module `page` shows the results, and `server` serves the page on
127.0.0.1. Only `page` and `server` need the optional dependencies "app".
"""
