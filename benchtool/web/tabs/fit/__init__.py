"""Fit tab."""
