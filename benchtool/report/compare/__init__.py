"""The page that sets runs and recordings side by side."""
