"""`gmwm app`: calibrate a recording in the browser, on your own machine.

A `Session` has the user's choices, a `Workspace` computes results, `page` shows them, and `server` serves on 127.0.0.1.
Only `page` and `server` need the optional dependencies "app"."""
