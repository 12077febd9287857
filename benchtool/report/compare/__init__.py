"""Report page that compares runs and recordings."""
