"""Rest and steady states: equilibria, small vibrations, steady running of machines."""
