"""Pages and figures of a sweep."""
