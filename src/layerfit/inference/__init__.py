"""From data to the numbers of a scene, with their uncertainty."""
