"""Distribution of a wrench over the cables."""
