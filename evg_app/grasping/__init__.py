"""TSDF grid in, ranked grasps out: the networks' planner, two baselines, weights with their cards."""
