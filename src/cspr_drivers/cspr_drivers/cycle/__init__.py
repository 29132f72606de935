"""The clock of the control cycle, and who kept to it: for drives and load cells alike."""
