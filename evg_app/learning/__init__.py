"""Learning: labelled scenes from the simulator, and the training of the grasp networks on them."""
