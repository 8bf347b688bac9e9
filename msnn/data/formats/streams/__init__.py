"""Reads recordings in which every signal has its own timestamps: MDF, ROS bags, TDMS, ULog."""
