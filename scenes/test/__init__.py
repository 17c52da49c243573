"""Scenes held back for testing; one module per scene."""
