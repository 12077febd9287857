"""Contracts and scripted links for authors of drivers and effects; only tests import it."""
