"""The control graph and a simulated robot in simulated time: nothing waits, and the same run gives the same bytes."""
