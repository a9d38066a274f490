"""The page of `gmwm app`: its five tabs as Dash components and callbacks. Needs the extra `app`."""
