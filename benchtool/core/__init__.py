"""What every other package uses: units, channels, recordings, errors, inputs."""
