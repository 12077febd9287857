"""The virtual counterpart of hardware, pure: no port, no clock, no randomness of its own."""
