"""What the sample is: layers, half space, surfaces, stack."""
