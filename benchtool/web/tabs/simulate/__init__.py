"""The Simulate tab."""
