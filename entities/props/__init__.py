"""Objects of the scenes."""
