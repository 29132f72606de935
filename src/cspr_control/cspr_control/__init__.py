"""Trajectories, feed-forward, motor control, payload estimation and supervision."""
