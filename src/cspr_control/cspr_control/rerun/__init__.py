"""Payload estimator and feed-forward once more over a recording."""
