"""The nouns that every other package speaks in: no I/O, no clock, no randomness."""
