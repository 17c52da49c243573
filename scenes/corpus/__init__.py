"""Made scenes: everything in one follows from its kind and its seed."""
