"""From something unknown to what it depends on, and a law of it."""
