"""Thrust curve and motor constants from throttle tests without a plate."""
