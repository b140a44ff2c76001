"""How long a test waits for what has to come."""

PATIENCE = 600.0  # [s] a wait that ends says that something hangs, never that the machine is busy
