"""Which model, and what it means: selection, the numbers of a datasheet, and recordings of one unit together."""
