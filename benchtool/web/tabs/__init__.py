"""The page's tabs, each a folder."""
