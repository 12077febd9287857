"""Pages and files of an explanation."""
