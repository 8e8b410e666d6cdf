"""Worker processes on Ray: the only package with Ray."""
