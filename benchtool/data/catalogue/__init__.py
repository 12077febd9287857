"""A catalogue of runs: an index over folders of runs, queries over all of them, copies of them."""
