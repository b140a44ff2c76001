"""Layers along z: which part lies on which, so that joined links lie face to face and none pass through each other."""
