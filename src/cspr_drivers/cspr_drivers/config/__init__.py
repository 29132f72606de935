"""Configuration of buses, devices and units."""
