"""Poses, rotations, twists and motions."""
