"""Figures and pages: arrays in, pictures out; the only home of matplotlib and jinja2.

Nothing here knows a model, a run folder or an estimator: the callers hand over plain arrays in
small frozen dataclasses, so that a simulation, a fit and a comparison are drawn by the same code.
"""
