"""The PyBullet world: objects, scenes, depth rendering and noise, and the simulated arm, gripper and camera."""
