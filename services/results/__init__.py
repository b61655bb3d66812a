"""What a session leaves in its folder, readable at every moment."""
