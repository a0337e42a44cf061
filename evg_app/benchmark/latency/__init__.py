"""How long the way from a depth image to ranked grasps takes, and how far that is from the limit of the machine."""
