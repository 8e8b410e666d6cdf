"""Adapters of vectorised environments and recordings to libraries with interfaces of their own."""
