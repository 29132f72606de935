"""Pose of the platform and payload, from angles and tensions."""
