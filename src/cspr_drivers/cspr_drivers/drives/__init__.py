"""The CiA 402 drives: their cycle, their states, their master."""
