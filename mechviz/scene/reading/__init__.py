"""Reading of scenes: from plain data to the readable parts of a document, with every fault of form and of names."""
