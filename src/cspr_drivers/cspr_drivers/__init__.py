"""CiA 402 drives and CiA 404 load cells over CAN, and their simulation."""
