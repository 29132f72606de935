"""The robot: geometry, cables, pulleys, winches, bodies, and the file that describes them."""
