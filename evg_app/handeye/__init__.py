"""Hand-eye calibration: boards, detection, solvers, errors one can trust, and what went wrong in words."""
