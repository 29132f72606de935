"""A simulated CAN bus on which frames take as long as on a real one."""
