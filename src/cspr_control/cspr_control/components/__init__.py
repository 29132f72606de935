"""The components of the control graph: each takes samples of topics and returns what it publishes."""
