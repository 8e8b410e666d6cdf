"""Worker processes on Ray; the only package that imports Ray, and imported itself only where there are workers."""
