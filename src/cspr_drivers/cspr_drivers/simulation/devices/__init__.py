"""Emulated CANopen devices."""
