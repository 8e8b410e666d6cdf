"""The kitchen domain: complete a set of tasks in any order."""
