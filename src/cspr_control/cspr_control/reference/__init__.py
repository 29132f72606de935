"""Trajectories, and the player that turns them into references."""
