"""Bench driver for autopilots, over MAVLink."""
