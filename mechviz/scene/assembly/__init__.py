"""From a scene document to the mechanism that the core computes."""
