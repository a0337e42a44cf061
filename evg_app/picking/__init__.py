"""The grasp loop: an explicit state machine over protocols, the same on hardware and in simulation."""
