"""A few lines of script for the page: its title, and keys that would otherwise do two things at once."""

from __future__ import annotations

import json

import viser
from viser import _messages

__all__ = ["prepare_page"]

# viser listens to hotkeys at the root element and turns the camera on arrow keys at the document, which comes after it.
# - An arrow key on a slider moves that slider only: stopped at the body, which comes before both.
# - Elsewhere an arrow key steps through the frames only: stopped at the root element, after the hotkeys.
# - Space presses the button that the keyboard has reached. A button that the mouse has pressed gives up the focus, so that space
#   means play and pause after it.
KEYS = """
if (!window.mechvizKeys) {
  window.mechvizKeys = true;
  const arrow = (event) => event.code.startsWith("Arrow");
  document.body.addEventListener("keydown", (event) => {
    const target = event.target;
    if (arrow(event) && target.closest("[role=slider]")) event.stopPropagation();
    if (event.code === "Space" && target.closest("button, [role=tab]")) event.stopPropagation();
  });
  document.documentElement.addEventListener("keydown", (event) => {
    if (arrow(event)) event.stopPropagation();
  });
  document.body.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (event.detail > 0 && button) button.blur();
  });
}
"""


def prepare_page(server: viser.ViserServer, title: str) -> None:
    """Send the script to every browser, now and later."""
    source = f"document.title = {json.dumps(title)};{KEYS}"
    server._websock_server.queue_message(_messages.RunJavascriptMessage(source=source))
