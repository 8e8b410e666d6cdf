"""Episodes: played, kept as files, reported."""
