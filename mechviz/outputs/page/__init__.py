"""Sharing without a server: a page that plays a mechanism, one HTML file."""
