"""Extensions of gmwm, found by the entry points of this package."""
