"""Recordings of many episodes: made, exported as datasets of Minari and LeRobot, replayed; and human demonstrations."""
