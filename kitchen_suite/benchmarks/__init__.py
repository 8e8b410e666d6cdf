"""Speed and memory of the suite beside bare MuJoCo and the baselines."""
