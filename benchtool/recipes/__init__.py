"""Fits as recipes: data, model and options in one file, so that a result can be made again."""
