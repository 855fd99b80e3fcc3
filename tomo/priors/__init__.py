"""What a solver knows of a volume beforehand: differences, total variation, bounds."""
