"""The demo: its scenario and its processes."""
