"""Every control of viewer and page is used by a test that drives it in a browser: a new one without a test is named here."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import mechviz.outputs.page
import mechviz.outputs.viewer

TESTS = Path(__file__).resolve().parents[1]
VIEWER = Path(mechviz.outputs.viewer.__file__).parent
PAGE = Path(mechviz.outputs.page.__file__).parent
CONTROL = re.compile("add_(button|button_group|slider|checkbox|dropdown|text|tab)")
NOT_USED = {"Size of the picture", "The diagram is seen", "Timeline"}  # two by which the page tells the server, and a heading


def driven(folder: str) -> str:
    """The source of the tests of a folder that open a page."""
    sources = [path.read_text(encoding="utf-8") for path in (TESTS / folder).glob("test_*.py") if path != Path(__file__)]
    return "\n".join(source for source in sources if "page." in source)


def labels_of(path: Path) -> set[str]:
    """Labels of the controls that a module makes, those of the options of its groups of buttons, and how labels of several begin;
    names that come from the scene are not among them."""
    name = ".".join(("mechviz.outputs.viewer", *path.relative_to(VIEWER).with_suffix("").parts)).removesuffix(".__init__")
    module = vars(importlib.import_module(name))
    labels: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and CONTROL.fullmatch(node.func.attr)):
            continue
        label, *rest = node.args
        if node.func.attr == "add_button_group":
            labels.update(eval(compile(ast.Expression(rest[0]), str(path), "eval"), module))
        elif isinstance(label, ast.JoinedStr):
            labels.add(str(getattr(label.values[0], "value", "")))
        elif isinstance(label, ast.Constant) or (isinstance(label, ast.Name) and isinstance(module.get(label.id), str)):
            labels.add(str(label.value if isinstance(label, ast.Constant) else module[label.id]))
    return labels


def test_every_control_of_the_viewer_is_used_in_a_browser():
    labels = set().union(*map(labels_of, VIEWER.rglob("*.py"))) - NOT_USED
    assert len(labels) > 60, "they are found"
    tests = driven("viewer")
    missing = {label for label in labels if not re.search(rf"""["'/=]{re.escape(label.split(" [")[0])}""", tests)}
    assert not missing


def test_every_control_of_the_page_is_used_in_a_browser():
    html, tests = (PAGE / "page.html").read_text(encoding="utf-8"), driven("page")
    controls = re.findall(r"<(?:button|select|input)\b[^>]*>[^<]*", html)
    assert len(controls) > 15, "they are found"
    missing = []
    for control in controls:
        names = [*re.findall(r'(?:aria-label|id)="([^"]+)"', control), control.partition(">")[2].strip()]
        before = re.search(r"([\w ]+?)\s*$", html[: html.index(control)])  # text of the label around it
        names += [before[1]] if before else []
        if not any(name and re.search(rf"""["'#]{re.escape(name)}["'\\ :\]]""", tests) for name in names):
            missing.append(control)
    assert not missing
