"""ROS 2 nodes, one module an executable."""
