"""The free body over surfaces."""
