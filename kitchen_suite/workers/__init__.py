"""Worker processes on Ray; the only package that imports Ray."""
