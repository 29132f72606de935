"""What every node needs of rclpy: processes, parameters, scheduling."""
