"""Arms and grippers behind two protocols."""
