"""CAN buses: ports, virtual bus, SocketCAN, load."""
