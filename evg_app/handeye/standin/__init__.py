"""A stand-in for arm and camera that renders the board. It alone knows the truth; no solver imports it."""
