"""The simulated machine on MuJoCo."""
