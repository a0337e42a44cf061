"""The live view in a browser: arm, scene, candidates, chosen path, camera image, counters. Needs the extra `viewer`."""
