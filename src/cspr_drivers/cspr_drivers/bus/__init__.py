"""CAN buses: ports, SocketCAN, load."""
