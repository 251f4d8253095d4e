"""What is special about a ring of sensors: orders, ring modes, the sensors' mass."""
