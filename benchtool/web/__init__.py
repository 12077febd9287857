"""The page: every tool of the command line in a browser, and live values of a bench."""
