"""Benchmarks of speed and memory against bare MuJoCo and other implementations."""
