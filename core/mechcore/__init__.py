"""The kinematic and kinetostatic core of mechviz: numpy and scipy only, no I/O, no pictures."""
