"""The payload, from the cable tensions."""
