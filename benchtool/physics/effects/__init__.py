"""One file an effect; the directory is the list of what the tool knows."""
