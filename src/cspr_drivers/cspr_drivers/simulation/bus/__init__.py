"""A CAN bus on which frames take the time that they take on copper."""
