"""Strict, frozen config models and the YAML files they are read from."""
