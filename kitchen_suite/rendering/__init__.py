"""Rendering: the choice of a GL library, cameras and mp4 videos."""
