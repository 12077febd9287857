"""Why a bench does not answer."""
