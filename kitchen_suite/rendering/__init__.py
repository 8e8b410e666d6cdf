"""Pictures and videos: the GL library, cameras, mp4 files."""
