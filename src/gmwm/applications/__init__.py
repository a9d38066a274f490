"""Tasks above a calibration: several signals, a monitor, fleets, navigation budgets, and the page in the browser."""
