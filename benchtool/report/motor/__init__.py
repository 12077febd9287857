"""Figures and page of thrust curve and motor constants."""
