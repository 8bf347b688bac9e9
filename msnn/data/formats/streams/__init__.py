"""Reads recordings in which every signal has its own timestamps: MDF and ROS bags."""
