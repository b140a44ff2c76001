"""The house keeps its order: dependencies point one way, without circles; what is imported within functions counts."""

from __future__ import annotations

import ast
import os
import re
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {"mechcore": ROOT / "core" / "mechcore", "mechviz": ROOT / "mechviz"}

# from the bottom up: a part imports from itself and from what stands before it; those in one tuple do not know each other
LAYERS = {
    "mechcore": (
        ("arrays", "cache", "constants", "records", "texts"), ("errors",), ("accuracy", "numerics"), ("laws",), ("spec",),
        ("cams",), ("joints",), ("topology",), ("kinematics",), ("branches", "compiled"), ("motion",), ("effects",), ("forces",),
        ("reduction", "dynamics"),
        ("constructions", "derivatives", "design"),
    ),
    "mechviz": (
        ("files", "meshes", "progress"), ("figures", "scene"), ("quantities",), ("accuracy",), ("runs",), ("picture",),
        ("automata", "editor", "studies"), ("outputs",), ("hard_cases",), ("facade",), ("commands",), ("__main__",),
    ),
}  # fmt: skip

# Imports of ours within functions of mechviz: what must not load before it is used (signals, viser, outlines, motion)
MOST_LAZY = 4
ADAPTERS = {  # the only module of a folder that uses the insides of a library, and how many lines of it do
    "mechviz.outputs.viewer": ("viser", "mechviz.outputs.viewer.viser_adapter", 10),
    "mechviz.outputs.rerun": ("rerun", "mechviz.outputs.rerun.rerun_adapter", 3),
}


class Import:
    """An import statement of ours: the module that has it, what it imports, and whether it stands within a function."""

    def __init__(self, source: str, target: str, *, lazy: bool, typed: bool):
        self.source, self.target, self.lazy, self.typed = source, target, lazy, typed

    def __repr__(self) -> str:
        return f"{self.source} -> {self.target}"


@cache
def modules() -> dict[str, Path]:
    result = {}
    for package, folder in PACKAGES.items():
        for path in sorted(folder.rglob("*.py")):
            parts = (package, *path.relative_to(folder).with_suffix("").parts)
            result[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return result


@cache
def tree(name: str) -> ast.Module:
    """A module's source, parsed."""
    return ast.parse(modules()[name].read_text(encoding="utf-8"))


def statements(node: ast.AST, lazy: bool = False, typed: bool = False) -> Iterator[tuple[ast.AST, bool, bool]]:
    """All statements in a node, whether they stand within a function, and whether for type checkers only."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.stmt | ast.excepthandler | ast.match_case):
            yield child, lazy, typed
            within = lazy or isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef)
            checked = typed or (isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test))
            yield from statements(child, within, checked)


@cache
def imports() -> tuple[Import, ...]:
    return tuple(i for name, path in modules().items() for i in _imports_of(name, path))


def _imports_of(name: str, path: Path) -> Iterator[Import]:
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    for node, lazy, typed in statements(tree(name)):
        targets: list[str] = []
        if isinstance(node, ast.Import):
            targets = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package.split(".")[: len(package.split(".")) - node.level + 1]) if node.level else ""
            home = ".".join(part for part in (base, node.module or "") if part)
            targets = [f"{home}.{alias.name}" if f"{home}.{alias.name}" in modules() else home for alias in node.names]
        for target in targets:
            if target in modules():
                yield Import(name, target, lazy=lazy, typed=typed)


def part(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


@pytest.mark.parametrize("package", PACKAGES)
def test_dependencies_point_one_way(package: str) -> None:
    level = {name: k for k, names in enumerate(LAYERS[package]) for name in names}
    own = [i for i in imports() if not i.typed and i.source.startswith(f"{package}.") and i.target.startswith(package)]
    assert {part(i.source) for i in own} <= level.keys(), "a part without a layer"
    across = [(part(i.source), part(i.target), i) for i in own if part(i.source) != part(i.target)]
    assert not [i for a, b, i in across if level.get(b, len(level)) >= level[a]]
    assert not [i for i in imports() if i.source.startswith("mechcore") and i.target.startswith("mechviz")]


def test_no_modules_import_each_other() -> None:
    """Not even within functions, where a circle would show only when the function is called."""
    graph: dict[str, set[str]] = {name: set() for name in modules()}
    for i in imports():
        if not i.typed and i.source != i.target:
            graph[i.source].add(i.target)
    TopologicalSorter(graph).prepare()  # raises CycleError, which names a circle


def test_imports_of_ours_stand_on_top() -> None:
    lazy = [i for i in imports() if i.lazy and not i.typed]
    assert not [i for i in lazy if i.source.startswith("mechcore")]
    assert len(lazy) <= MOST_LAZY


def test_what_all_lists_is_a_facade() -> None:
    lists = [
        name for name, path in modules().items() if path.name != "__init__.py" and "\n__all__" in path.read_text(encoding="utf-8")
    ]
    assert not lists


def test_nothing_private_crosses_modules() -> None:
    for name in modules():
        for node, _, _ in statements(tree(name)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in PACKAGES:
                private = [a.name for a in node.names if a.name.startswith("_")]
                assert not private, f"{name} imports {private} from {node.module}"


def test_every_refusal_has_a_remedy() -> None:
    """What to do is said with what is wrong, and stands by itself."""
    places = {"Fault": 2, "fault": 1, "note": 2, "OutputError": 1, "RecordingError": 1, "ChromiumError": 1}
    for name in modules():
        for node in ast.walk(tree(name)):
            called = getattr(node, "func", None)
            place = places.get(getattr(called, "id", getattr(called, "attr", "")))
            if isinstance(node, ast.Call) and place is not None and not any(isinstance(a, ast.Starred) for a in node.args):
                given = {k.arg: k.value for k in node.keywords}
                remedy = node.args[place] if len(node.args) > place else given.get("remedy")
                assert remedy is not None, f"{name}, line {node.lineno}: no remedy"
                words = ast.unparse(remedy).lstrip("f").strip("'\"")
                assert words and not words.startswith("Or "), f"{name}, line {node.lineno}: {words!r}"


def test_types_of_arrays_are_defined_once() -> None:
    core = {name: path.read_text(encoding="utf-8") for name, path in modules().items() if name.startswith("mechcore.")}
    assert not [name for name, text in core.items() if "\nReal = " in text and name != "mechcore.arrays"]
    assert not [name for name, text in core.items() if "\nArray = Any\n" in text]


@pytest.mark.parametrize("folder", ADAPTERS)
def test_the_insides_of_a_library_are_used_in_one_module(folder: str) -> None:
    """``viser.infra``, ``rerun_bindings``, private modules, and attributes with an underscore of anything but our own ``self``."""
    library, adapter, most = ADAPTERS[folder]
    for name in modules():
        if not name.startswith(folder):
            continue
        lines: set[int] = set()
        for node in ast.walk(tree(name)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == library:
                inside = "infra" in f"{node.module}.{[a.name for a in node.names]}" or any(a.name[0] == "_" for a in node.names)
                lines |= {node.lineno} if inside else set()
            elif isinstance(node, ast.Import) and any(a.name.split(".")[0] == f"{library}_bindings" for a in node.names):
                lines |= {node.lineno}
            elif isinstance(node, ast.Attribute) and node.attr[0] == "_" and node.attr[:2] != "__":
                own = isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")
                lines |= set() if own or node.attr == "_replace" else {node.lineno}  # `_replace` of a NamedTuple is public
        assert not lines or (name == adapter and len(lines) <= most), f"{name}: lines {sorted(lines)}"


RESULTS = {  # what the core's façade gives, and results that it leads to
    "mechcore.motion.motion": ("Motion",),
    "mechcore.forces.kinetostatics": ("Forces",),
    "mechcore.forces.friction.solve": ("FrictionResult",),
    "mechcore.forces.section_forces": ("SectionForces",),
    "mechcore.dynamics.simulation": ("Simulation",),
    "mechcore.dynamics.joined": ("JoinedMotion", "JoinedForces", "JoinedFriction"),
    "mechcore.cams.synthesis": ("Synthesis", "Cam"),
    "mechcore.cams.analysis": ("Contact",),
    "mechcore.reduction.reduced": ("Reduced",),
    "mechcore.reduction.balancing": ("Shaking",),
}
SHAPE = re.compile(r"\([A-Za-z0-9*+ ._-]+,[^)]*\)|\([Fn]\)|as many|frame by frame")
UNIT = re.compile(r"\[[^\]]+\]|relative|unit vector|dimensionless|derivatives")


def test_results_state_their_shapes_and_units() -> None:
    """The docstrings of public values of results that are arrays; what overrides a documented one may be silent."""
    silent: list[str] = []
    for name, classes in RESULTS.items():
        known = {n.name: n for n in tree(name).body if isinstance(n, ast.ClassDef)}
        for node in (known[c] for c in classes):
            for method in node.body:
                if not isinstance(method, ast.FunctionDef) or method.name.startswith("_") or method.returns is None:
                    continue
                text = ast.get_docstring(method)
                if not {"Real", "Complex"} & set(re.findall(r"\w+", ast.unparse(method.returns))) or (text is None and node.bases):
                    continue
                shaped = SHAPE.search(text or "") or "all arrays are" in (ast.get_docstring(node) or "")
                if not (text and shaped and UNIT.search(text)):
                    silent.append(f"{name}.{node.name}.{method.name}: {(text or 'nothing').splitlines()[0]}")
    assert not silent, "\n".join(silent)


def test_the_tests_of_a_group_stay_in_one_process(request: pytest.FixtureRequest) -> None:
    """pytest-xdist keeps those together whose names end with their group. Under a pytest that it does not know it says nothing."""
    if os.environ.get("PYTEST_XDIST_WORKER"):
        assert request.node.nodeid.endswith("@test_house")
