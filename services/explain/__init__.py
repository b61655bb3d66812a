"""What the planner saw, decided and why, as a picture: a subject in all its variants, and a session's timeline."""
