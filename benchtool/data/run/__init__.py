"""A run folder: settings, samples, points and events."""
