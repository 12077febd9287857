"""Evidence of a plate sweep."""
