"""The CiA 404 load cells: their cycle and their master."""
