"""From plain data to what can be read of a scene, with every fault of form and of names."""
