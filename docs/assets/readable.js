// What scrolls sideways is reached by the keyboard, once the theme has wrapped its tables.
addEventListener("load", () => setTimeout(() => {
  for (const box of document.querySelectorAll("pre code, table.docutils, .wy-table-responsive"))
    if (box.scrollWidth > box.clientWidth || box.tagName === "TABLE") box.tabIndex = 0;
}));
