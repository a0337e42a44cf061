"""Rotation-equivariant grasp networks (EquiGIGA, EquiIGD) in plain PyTorch: no files, no devices."""
