"""The Franka Panda and its two specifications: the kitchen's and the Panda's own."""
