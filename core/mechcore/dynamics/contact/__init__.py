"""What touches and lets go: dry friction, end stops and impacts, followers that leave their cams."""
