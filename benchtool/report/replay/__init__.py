"""Pages of a replayed recording."""
