"""Effects and loads by families: what each needs and the wrenches that it adds. `registry` lists them."""
