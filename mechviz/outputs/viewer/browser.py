"""Scripts for the page: title and layout, keys that would otherwise have two effects at once, names for screen readers."""

from __future__ import annotations

import json
from importlib.resources import files

import viser

from mechviz.outputs.viewer.viser_adapter import run_script

# viser listens for hotkeys at the root element, and for arrow keys and letters that move the camera at the document, which an event
# reaches later.
# - An arrow key on a slider moves only that slider: the event is stopped at the body, before both.
# - Elsewhere an arrow key only steps through the frames, and E only goes to an event of the motion: stopped at the root element,
#   after the hotkeys.
# - Space presses the button that has the keyboard focus. A button pressed by the mouse loses the focus, so that space then plays
#   and pauses.
# - Escape cancels a dialog: viser leaves closing it to the server.
KEYS_SCRIPT = """
if (!window.mechvizKeys) {
  window.mechvizKeys = true;
  const arrow = (event) => event.code.startsWith("Arrow");
  document.body.addEventListener("keydown", (event) => {
    const target = event.target;
    if (arrow(event) && target.closest("[role=slider]")) event.stopPropagation();
    if (event.code === "Space" && target.closest("button, [role=tab]")) event.stopPropagation();
    if (event.code === "Escape")
      for (const button of document.querySelectorAll("[role=dialog] button"))
        if (button.textContent.trim() === "Cancel") button.click();
  });
  document.documentElement.addEventListener("keydown", (event) => {
    if (arrow(event) || event.code === "KeyE") event.stopPropagation();
  });
  document.body.addEventListener("click", (event) => {
    const button = event.target.closest("button");
    if (event.detail > 0 && button) button.blur();
  });
}
"""


# viser labels the row of a control, but neither the thumb of its slider nor the number field beside it: screen readers need labels.
NAMES_SCRIPT = """
if (!window.mechvizNames) {
  const ICONS = { "list-search": "Search for a command", "adjustments": "Settings and connection" };
  const name = () => {
    window.mechvizNames.waiting = 0;
    for (const label of document.querySelectorAll("label[for]")) {
      const control = document.getElementById(label.htmlFor), text = label.textContent.trim();
      if (!text) continue;
      const row = (control || label).parentElement;
      const parts = [...(control ? control.querySelectorAll("[role=slider], input") : []), ...row.querySelectorAll("input")];
      if (!control) parts.push(...(label.closest(".mantine-Flex-root") || row.parentElement).querySelectorAll("input"));
      for (const part of parts)
        if (!part.getAttribute("aria-label") && !(part.labels && part.labels.length)) part.setAttribute("aria-label", text);
    }
    for (const button of document.querySelectorAll(".mantine-Notification-closeButton:not([aria-label])"))
      button.setAttribute("aria-label", "Close");
    for (const head of document.querySelectorAll('[role=button][aria-label^="Expand panel"]')) {  // on a phone it shows more words
      const words = head.textContent.trim();
      if (!head.getAttribute("aria-label").includes(words)) head.setAttribute("aria-label", `Expand panel ${words}`);
    }
    // viser's own dialogs and settings
    for (const dialog of document.querySelectorAll("section[role=dialog]:not([aria-label])"))
      if (!document.getElementById(dialog.getAttribute("aria-labelledby")))
        dialog.setAttribute("aria-label", dialog.querySelector("input")?.placeholder || "Dialog");
    for (const opener of document.querySelectorAll("div[aria-haspopup=dialog]:not([role])")) {
      opener.setAttribute("role", "button");
      opener.setAttribute("aria-label", opener.querySelector("[aria-label]")?.getAttribute("aria-label") || "Open");
    }
    for (const image of document.querySelectorAll("img:not([alt])")) image.alt = "";
    for (const input of document.querySelectorAll("input:not([aria-label])"))
      if (/^wss?:/.test(input.value)) input.setAttribute("aria-label", "Address of the server");
    for (const button of document.querySelectorAll(".mantine-ActionIcon-root:not([aria-label])")) {
      const icon = (button.innerHTML.match(/tabler-icon-([a-z-]+)/) || ["", "button"])[1];  // viser's own, in the heads of panels
      button.setAttribute("aria-label", ICONS[icon] || icon.replaceAll("-", " "));
    }
  };
  window.mechvizNames = { waiting: 0 };
  // Numbers and pictures change all the time: only new controls need names
  const NEW = "label[for], input, img, [role=slider], [role=button], [role=dialog], [aria-haspopup=dialog], " +
    ".mantine-Notification-closeButton, .mantine-ActionIcon-root";
  const isNew = (node) => node.nodeType === 1 && (node.matches(NEW) || !!node.querySelector(NEW));
  new MutationObserver((changes) => {
    if (!window.mechvizNames.waiting && changes.some((change) => [...change.addedNodes].some(isNew)))
      window.mechvizNames.waiting = setTimeout(name, 300);
  }).observe(document.body, { childList: true, subtree: true });
  name();
}
"""

# A click on a mark of a chart sets a control to the number of the mark, as if the user had moved the control.
PICK_SCRIPT = """
if (!window.mechvizPick) {
  window.mechvizPick = true;
  document.body.addEventListener("click", (event) => {
    const mark = event.target.closest("[data-mv-pick]"), viser = window.__viserMutable;
    if (!mark || !viser) return;
    const [uuid, value] = mark.dataset.mvPick.split(":");
    const message = { type: "GuiUpdateMessage", uuid, updates: { value: Number(value) } };
    viser.sendMessage(message);
    viser.messageQueue.push(message);
  });
}
"""

# The cursor of the health strip follows the numbers above the slider: the strip itself need not be sent again.
CURSOR_SCRIPT = """
if (!window.mechvizCursor) {
  window.mechvizCursor = true;
  const lines = document.getElementsByClassName("mechviz-now");
  let waiting = false, place = null;
  const move = () => {
    waiting = false;
    if (!place || !place.isConnected) place = lines.length ? document.querySelector("[data-mv-part]") : null;
    if (!place || (window.mechvizPlayback && window.mechvizPlayback.running)) return;
    for (const line of lines)
      for (const end of ["x1", "x2"]) line.setAttribute(end, 1000 * Number(place.dataset.mvPart));
  };
  new MutationObserver(() => {
    if (!waiting) { waiting = true; setTimeout(move, 30); }
  }).observe(document.body, { childList: true, subtree: true });
  move();
}
"""


# viser empties its queue of messages when the next frame is drawn, and React brings its share (vertices, arrows, lines) into the
# frame after that. If the queue is emptied as soon as messages arrive, everything appears in one frame, the next one.
# After each message viser keeps drawing for a quarter of a second, for textures, letters and the like that load late. Poses, points
# and panels do not load late: one frame is enough, and another one after 150 ms, so that the next move need not wait for frames.
PROMPT_SCRIPT = """
(() => {
  const viser = window.__viserMutable;
  if (window.mechvizPrompt || !viser || !viser.drainMessageQueue || !viser.requestRender) return;
  window.mechvizPrompt = true;
  const AT_ONCE = new Set(["SetPositionMessage", "SetOrientationMessage", "GuiUpdateMessage", "RunJavascriptMessage",
    "SetSceneNodeVisibilityMessage"]);
  const MOVES = new Set(["points", "vertices", "scale", "batched_positions", "batched_wxyzs", "batched_scales"]);
  const isAtOnce = ({ type, updates }) =>
    AT_ONCE.has(type) || (type === "SceneNodeUpdateMessage" && Object.keys(updates).every((prop) => MOVES.has(prop)));
  let request = viser.requestRender, taking = null, rest = 0;
  const invalidate = () => {
    const own = viser.scene && viser.scene.__r3f, store = own && (own.root || own), state = store && store.getState;
    return state ? state().invalidate : null;
  };
  const prompt = () => {
    const ready = viser.getRenderRequestState === "ready" && viser.drainMessageQueue && !viser.firstMessageBatch;
    if (taking) return taking === "known" ? undefined : request();
    if (!ready || !viser.messageQueue.length) return request();
    const draw = viser.messageQueue.every(isAtOnce) && invalidate();
    taking = draw ? "known" : "other";
    try { viser.drainMessageQueue(); } finally { taking = null; }
    if (!draw) return request();
    draw(1);
    clearTimeout(rest);
    rest = setTimeout(draw, 150, 1);
  };
  Object.defineProperty(viser, "requestRender", { configurable: true, enumerable: true, get: () => prompt,
    set: (other) => { request = other; } });
})();
"""


def prepare_page(server: viser.ViserServer, title: str) -> None:
    """Send the title and the scripts to every browser that is or will be connected."""
    source = f"document.title = {json.dumps(title)};{KEYS_SCRIPT}{NAMES_SCRIPT}{PICK_SCRIPT}{CURSOR_SCRIPT}{PROMPT_SCRIPT}"
    run_script(server, source, "page")


# The size of the picture as a control of the page: viser states it in device pixels, which do not scale with the letters.
SIZE_SCRIPT = """
{ const tell = () => {
    const { clientWidth: wide, clientHeight: high } = window.__viserMutable.canvas, value = `${wide}x${high}`;
    if (value === window.mechvizSize.told || !wide || !high) return;
    window.mechvizSize.told = value;
    window.__viserMutable.sendMessage({ type: "GuiUpdateMessage", uuid: UUID, updates: { value } });
  };
  const start = () => {
    if (!(window.__viserMutable || {}).canvas) return setTimeout(start, 100);
    if (window.mechvizSize) window.mechvizSize.disconnect();
    let waiting = 0;
    window.mechvizSize = new ResizeObserver(() => { clearTimeout(waiting); waiting = setTimeout(tell, 150); });
    window.mechvizSize.observe(window.__viserMutable.canvas);
  };
  start(); }
"""


def report_size(server: viser.ViserServer, uuid: str) -> None:
    """Let every browser, present and future, write the size of its picture [px] into a text control, as ``600x500``."""
    run_script(server, SIZE_SCRIPT.replace("UUID", json.dumps(uuid)), "size")


# viser's tabs can be dragged: they open after a pointer has been pressed and released on them, not on a click event alone.
OPEN_TAB = """
for (const tab of document.querySelectorAll("[role=tab]")) {
  if (tab.textContent.trim() !== NAME || tab.getAttribute("aria-selected") === "true") continue;
  const box = tab.getBoundingClientRect();
  const where = { clientX: box.x + box.width / 2, clientY: box.y + box.height / 2, button: 0, pointerId: 1 };
  for (const type of ["pointerdown", "mousedown", "pointerup", "mouseup", "click"])
    tab.dispatchEvent(new PointerEvent(type, { bubbles: true, cancelable: true, isPrimary: true, ...where }));
}
"""


def open_tab(client: viser.ClientHandle | None, name: str) -> None:
    """Open a tab in one browser: viser has no function for it."""
    if client is not None:
        run_script(client, OPEN_TAB.replace("NAME", json.dumps(name)), "open tab")


# On a phone in landscape format, both docks are folded when the page opens: the picture gets the room, and a tap opens a dock.
FOLD_SCRIPT = """
if (!window.mechvizFold) {
  const low = window.mechvizFold = matchMedia("(max-height: 480px) and (min-width: 36.01em)"), folded = new Set();
  const fold = (left) => {
    if (!low.matches) return;
    for (const button of document.querySelectorAll("[data-dock-region-collapse][aria-expanded=true]")) {
      const side = button.dataset.dockRegionCollapse;
      if (!folded.has(side)) { folded.add(side); button.click(); setTimeout(() => document.activeElement.blur(), 50); }
    }
    if (left && folded.size < 2) setTimeout(fold, 200, left - 1);
  };
  low.addEventListener("change", () => { folded.clear(); fold(50); });
  fold(50);
}
"""

# The timeline is a strip below the picture; on phones it is a drawer.
LAYOUT_SCRIPT = """{ let own = document.getElementById("mechviz-layout");
  if (!own) { own = document.createElement("style"); own.id = "mechviz-layout"; document.head.append(own); }
  own.textContent = STYLE; }"""


def lay_out(server: viser.ViserServer) -> None:
    """Give the page of every browser, present and future, the layout of ``layout.css``."""
    style = files(__package__).joinpath("layout.css").read_text(encoding="utf-8")
    run_script(server, LAYOUT_SCRIPT.replace("STYLE", json.dumps(style)) + FOLD_SCRIPT, "layout")
