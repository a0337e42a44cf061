"""The clutter-removal benchmark (spec §6): scenes, rounds, rates with intervals, paired comparison."""
