"""The pick_and_place domain: objects of generated kitchens are picked up and put away."""
