"""What moves the plate."""
