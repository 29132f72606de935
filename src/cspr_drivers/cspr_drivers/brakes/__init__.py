"""Holding brakes: motors that turn although they are closed, and the proof that they hold."""
