"""Contacts that close and open: dry friction, end stops and impacts, followers that leave their cams."""
