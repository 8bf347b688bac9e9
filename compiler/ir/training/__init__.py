"""What training is told by programs, and gives to graphs of its own."""
