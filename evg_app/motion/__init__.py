"""Kinematics, collision, and paths: from ranked grasps to checked, timed joint trajectories."""
