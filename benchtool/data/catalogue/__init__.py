"""A catalogue of runs: an index over folders of runs, and queries over all of them."""
