"""The command line. Commands call only public functions, so Python can do everything that a command does."""
