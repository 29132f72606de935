"""Payload estimator and feed-forward re-run over a recording."""
