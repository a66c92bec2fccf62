"""What was measured: geometry, values and noise, and how they are read from files."""
