"""What accuracy costs: error against time at a ladder of settings, timed, kept and drawn."""
