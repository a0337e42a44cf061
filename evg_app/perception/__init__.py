"""From depth images to what the planner and the motion rooms need: TSDF, collision volume, self filter, health."""
