"""Autopilots as benches."""
