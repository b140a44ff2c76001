"""The compiled model and its equations at given drive positions: positions, rates, and the tree of the statics."""
