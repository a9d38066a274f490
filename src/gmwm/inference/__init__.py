"""Using a model on paper: what other recordings of it would have given."""
