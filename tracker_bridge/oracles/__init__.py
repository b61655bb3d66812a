"""What the eye side is judged by: other people's methods, offline and over a whole recording. No product imports it."""
