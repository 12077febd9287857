"""Named physical effects that add to a model: one file each, listed in `catalogue`."""
