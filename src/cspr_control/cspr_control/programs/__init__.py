"""Programs that end by themselves, other than nodes."""
