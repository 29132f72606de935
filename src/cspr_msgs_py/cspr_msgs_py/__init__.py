"""The shared vocabulary of the node graph: topics, message conversion and MCAP bags."""
