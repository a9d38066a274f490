"""What the site needs of Sphinx beyond its own extensions: formulas without a network, our docstrings, our pages."""
