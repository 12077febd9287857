"""Search for the variable and the law of an unnamed effect."""
