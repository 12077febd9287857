"""The Runs tab: everything in the runs folder, to search, open, compare and take home."""
