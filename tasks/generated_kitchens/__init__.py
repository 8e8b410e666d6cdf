"""The kitchens domain: tasks by kind in generated kitchens."""
