"""Numbers of recorded runs."""
