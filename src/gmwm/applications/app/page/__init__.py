"""The page of `gmwm app`: Dash components and callbacks of its five tabs. It needs the optional dependencies "app"."""
