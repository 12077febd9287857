"""One file a command: its inputs, what it runs and what it prints."""
