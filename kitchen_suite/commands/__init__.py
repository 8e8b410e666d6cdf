"""The command lines: the only package with absl flags."""
