"""The tab Simulate: controllers side by side on the pitch bench and in flight."""
