"""Available wrenches, workspace, interference."""
