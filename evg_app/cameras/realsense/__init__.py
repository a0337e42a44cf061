"""Intel RealSense cameras through librealsense (extra `realsense`), live or from a .db3 recording."""
