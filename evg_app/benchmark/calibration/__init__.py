"""How good hand-eye calibration is: good sessions against their truth, and deliberately bad ones."""
