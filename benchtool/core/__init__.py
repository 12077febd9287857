"""Base types of all packages: units, channels, recordings, errors, inputs."""
