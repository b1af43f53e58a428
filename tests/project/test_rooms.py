# SPDX-License-Identifier: BSD-2-Clause
"""Which room may import which: arrows one way, no circles, as docs/architecture.md says."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

import sst_pin

PACKAGE = Path(sst_pin.__file__).parent
ROOT = Path(__file__).resolve().parents[2]

#: From the ground up: a room imports itself and the rows above its own here, nothing else.
ROWS = (
    {"errors", "version"},
    {"arrays", "extensions", "files", "summaries"},
    {"chain"},
    {"motion", "compiled", "robots"},
    {"reading", "control"},
    {"validation", "identification"},
    {"description"},
    {"sst"},
    {"verification"},
    {"plots", "viewer"},
    {"cli"},
    {"sst_pin", "__main__"},  # what a user imports
)
ROW = {room: i for i, rooms in enumerate(ROWS) for room in rooms}

#: Methods that hand on to a room above, by module: the only imports that lead upwards.
FORWARDING = {
    "sst_pin.chain.closed_chain": {
        f"ClosedChain.{name}"
        for name in (
            *("from_urdf", "from_mjcf", "_of_file", "trajectory", "simulate", "rollout", "check"),
            *("_verdicts", "loads", "_moving_load", "show", "_page_functions"),
            *("compile", "casadi", "jax"),
        )
    }
}

MODULES = {
    ".".join(("sst_pin", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(
        ".__init__"
    ): path
    for path in PACKAGE.rglob("*.py")
}


class Import(NamedTuple):
    """One import of ours: the module that is meant, the method that asks, the names bound."""

    target: str
    method: str
    typing_only: bool
    names: frozenset[str]


def room(module: str) -> str:
    """The first name below the package's; the package itself is a room too."""
    return module.split(".")[1] if "." in module else module


def scoped(
    node: ast.AST, scope: tuple[str, ...] = (), typing_only: bool = False
) -> Iterator[tuple[ast.AST, str, bool]]:
    """All nodes below one, what they stand in, and whether they are under TYPE_CHECKING."""
    for child in ast.iter_child_nodes(node):
        yield child, ".".join(scope), typing_only
        named = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        guard = isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test)
        inside = (*scope, child.name) if named else scope
        yield from scoped(child, inside, typing_only or guard)


def imports(tree: ast.AST, module: str, is_package: bool) -> Iterator[Import]:
    """All of them, in functions and under TYPE_CHECKING too."""
    package = module.split(".") if is_package else module.split(".")[:-1]
    for node, method, typing_only in scoped(tree):
        if not isinstance(node, ast.Import | ast.ImportFrom):
            continue
        source = ""
        if isinstance(node, ast.ImportFrom):
            base = package[: len(package) + 1 - node.level] if node.level else []
            source = ".".join([*base, *filter(None, [node.module])])
        for alias in node.names:
            target = f"{source}.{alias.name}" if source else alias.name
            bound = alias.asname or (alias.name if source else alias.name.split(".")[0])
            if source and target not in MODULES:
                target = source
            if target.split(".")[0] == "sst_pin":
                yield Import(target, method, typing_only, frozenset({bound}))


def used_in(tree: ast.AST, name: str) -> set[str]:
    """The methods and functions that use a name, annotations included."""
    nodes = scoped(tree)
    return {method for x, method, _ in nodes if isinstance(x, ast.Name) and x.id == name}


def forwarded(tree: ast.AST, module: str, found: Import) -> bool:
    """Whether only forwarding methods need it: inside them, or for the types they name."""
    allowed = FORWARDING.get(module, set())
    if found.typing_only:
        used = set().union(*(used_in(tree, name) for name in found.names))
        return bool(used) and used <= allowed
    return found.method in allowed


def judged(source: str, module: str, is_package: bool = False) -> tuple[set[str], list[str]]:
    """What a module imports of ours, forwarding left out, and what of it leads upwards."""
    tree = ast.parse(source)
    found = list(imports(tree, module, is_package))
    kept = [each for each in found if not forwarded(tree, module, each)]
    own = room(module)
    above = [x.target for x in kept if room(x.target) != own and ROW[room(x.target)] >= ROW[own]]
    up = [f"{module} imports {target}" for target in above]
    return {each.target for each in kept}, up


def judged_package() -> dict[str, tuple[set[str], list[str]]]:
    return {
        module: judged(path.read_text(encoding="utf-8"), module, path.name == "__init__.py")
        for module, path in MODULES.items()
    }


def test_every_room_has_its_place() -> None:
    assert {room(module) for module in MODULES} <= ROW.keys()


def test_a_file_name_stands_once() -> None:
    folders = (PACKAGE, *(ROOT / name for name in ("tests", "scripts", "examples")))
    files = (path for folder in folders for path in folder.rglob("*.py"))
    names = [path.stem for path in files if path.name != "__init__.py"]
    assert sorted(set(names)) == sorted(names)


def test_no_import_leads_upwards_or_to_a_neighbour() -> None:
    assert [sentence for _, up in judged_package().values() for sentence in up] == []


def test_modules_import_each_other_in_no_circle() -> None:
    """There is an order in which every module comes after all that it imports, at any time."""
    graph = {module: targets - {module} for module, (targets, _) in judged_package().items()}
    TopologicalSorter(graph).prepare()  # raises CycleError with the circle


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("sst_pin.chain.noc", "from ..sst import kinematics"),
        ("sst_pin.chain.noc", "def f():\n    from ..motion.energy import energy_error"),
        ("sst_pin.chain.noc", "from .. import cli"),
        ("sst_pin.chain.noc", "import sst_pin"),
        ("sst_pin.motion.energy", "if TYPE_CHECKING:\n    from ..sst.robot import SST"),
        ("sst_pin.plots.style", "from ..viewer import Viewer"),
        (
            "sst_pin.chain.closed_chain",
            "if TYPE_CHECKING:\n    from ..motion.trajectories import Trajectory\n"
            "class ClosedChain:\n    def noc(self) -> Trajectory: ...",
        ),
        (
            "sst_pin.chain.closed_chain",
            "class ClosedChain:\n    def noc(self):\n        from ..reading import parse_urdf",
        ),
    ],
)
def test_an_import_that_leads_upwards_is_seen(module: str, source: str) -> None:
    """At the top, in a function, of a package, of all, for types, to a neighbour."""
    _, up = judged(source, module)
    assert len(up) == 1


def test_forwarding_methods_may_look_up() -> None:
    source = (
        "if TYPE_CHECKING:\n    from ..motion.trajectories import Trajectory\n"
        "class ClosedChain:\n    def simulate(self) -> Trajectory:\n"
        "        from ..motion.simulation import simulate\n"
    )
    assert judged(source, "sst_pin.chain.closed_chain") == (set(), [])


def test_scripts_know_no_tests_and_change_no_path() -> None:
    """Tests may use what scripts hold; a script finds its helpers beside itself."""
    helpers = {path.stem for path in (ROOT / "tests").rglob("*.py")}
    for path in (ROOT / "scripts").rglob("*.py"):
        beside = {other.stem for other in path.parent.iterdir()}
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                roots = {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                roots = {str(node.module).split(".")[0]}
            else:
                roots = set()
            assert roots.isdisjoint(helpers - beside), path
        assert "sys.path" not in path.read_text(encoding="utf-8"), path
