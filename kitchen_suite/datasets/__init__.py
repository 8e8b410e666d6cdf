"""Datasets of other programs, made of recordings; and recordings made of demonstrations of people."""
