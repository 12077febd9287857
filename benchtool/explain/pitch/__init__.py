"""Evidence of a pitch bench."""
