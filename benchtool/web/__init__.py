"""The page: see the bench live, run a sweep, fit and explain from a browser; the only async code.

The server here asks and watches. Whatever turns motors lives in a process of its own (`desk`).
"""
