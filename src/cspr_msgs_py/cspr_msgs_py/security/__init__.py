"""Who may do what in the graph, and the SROS 2 policies that say so."""
