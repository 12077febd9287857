"""Estimate parameters from recordings."""
