"""The page in the browser; the only async code.

The server here asks and watches. Whatever turns motors lives in a process of its own (`desk`).
"""
