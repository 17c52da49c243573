"""Scenes that the search is trained on; one module per scene."""
