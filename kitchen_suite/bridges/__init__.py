"""Adapters of the vectorised environments to libraries with interfaces of their own."""
