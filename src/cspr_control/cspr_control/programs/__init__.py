"""Programs that are not nodes."""
