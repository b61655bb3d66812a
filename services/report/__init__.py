"""What a person looks at after a session: report.html, from the files that the session left."""
