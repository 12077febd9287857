"""Figures and pages; the only package with matplotlib."""
