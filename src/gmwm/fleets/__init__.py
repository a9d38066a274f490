"""Many units of one type: each calibrated, and what they tell together."""
