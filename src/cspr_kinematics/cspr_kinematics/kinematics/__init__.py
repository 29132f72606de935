"""Inverse and forward kinematics."""
