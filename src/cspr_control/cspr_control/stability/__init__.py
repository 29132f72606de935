"""How far the sampled closed loop is from instability, computed from the configuration."""
