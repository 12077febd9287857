"""Runs on disk and files of other makers."""
