"""Pictures and films: drawings without a browser, and the shared page in headless Chromium."""
