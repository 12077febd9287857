"""Devices that answer like real ones."""
