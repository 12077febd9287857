"""The serial protocol and its driver."""
