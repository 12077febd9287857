"""Feedback laws as values: expressions that any loop can run, compiled or not."""
