"""Benchmarks: what the program claims, measured by the same commands for everybody."""
