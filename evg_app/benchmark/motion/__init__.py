"""The motion benchmark: reachability, contacts and limits of whole picks, judged by others than the planner."""
