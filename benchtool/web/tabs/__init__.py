"""Tabs of the page, one package each."""
