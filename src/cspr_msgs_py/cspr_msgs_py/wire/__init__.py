"""Messages as they go over the wire, and their conversion."""
