"""The Franka Panda and its two specifications."""
