"""One file an effect or load: what it needs and the wrenches that it adds. `registry` lists them."""
