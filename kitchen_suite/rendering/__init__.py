"""Rendering: the choice of a GL library, cameras, render quality, mp4 videos and web pages."""
