"""Feed-forward and motor control."""
