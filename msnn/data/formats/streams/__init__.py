"""Reads recordings in which every signal has times of its own: MDF and ROS bags."""
