"""Data flows one way: every import of the package points down the list, and heavy packages stay where they belong."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import piezoharvest

ROOT = Path(piezoharvest.__file__).parent
# From the bottom to the top; what stands in one line does not know of each other.
LAYERS = [
    {"parameters", "circuit", "input"},
    {"readers"},
    {"hysteresis", "netlist", "effects", "excitation"},
    {"shunts", "transducer"},
    {"system", "catalogue", "limits"},
    {"terms"},
    {"equations"},
    {"linear", "engine"},
    {"spice"},
    {"study", "output"},
    {"records"},
    {"predict"},
    {"identify", "design", "sweep"},
    {"diagnose"},
    {"report"},
    {"demo"},
    {"cli"},
    {"__main__"},
]
RANK = {name: rank for rank, layer in enumerate(LAYERS) for name in layer}
# Packages that only these parts may use, wherever in a file the import stands.
ONLY = {
    "numba": {"engine", "predict"},
    "scipy.integrate": {"engine"},
    "matplotlib": {"report"},
    "jinja2": {"report"},
    "dask": {"sweep"},
    "distributed": {"sweep"},
    "typer": {"cli"},
    "rich": {"cli"},
    "pydantic": {"study", "records"},
}
FILES = sorted(ROOT.rglob("*.py"))


def part(path):
    """Top-level part of the package that a file belongs to."""
    first = path.relative_to(ROOT).parts[0]
    return first.removesuffix(".py")


def imports(path):
    """Full names of all that a file imports, within functions too."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: imports are absolute here"
            yield from ((f"{node.module}.{alias.name}", node.lineno) for alias in node.names)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_downwards(path):
    own = part(path)
    if own == "__init__":
        return
    assert own in RANK, f"{own} has no place in the order: give it one in {__file__}"
    for name, line in imports(path):
        words = name.split(".")
        if words[0] != "piezoharvest" or name in ("piezoharvest", "piezoharvest.__version__"):
            continue
        used = words[1]
        assert used in RANK, f"{path}:{line}: {used} has no place in the order"
        assert used == own or RANK[used] < RANK[own], f"{path}:{line}: {own} imports {used}, which is not below it"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_whole_package_is_asked_for_its_version_only(path):
    """What else it offers comes from above, by way of its front."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "piezoharvest":
            assert node.attr == "__version__", f"{path}:{node.lineno}: piezoharvest.{node.attr}"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_heavy_packages_stay_where_they_belong(path):
    for name, line in imports(path):
        for package, places in ONLY.items():
            if name == package or name.startswith(package + "."):
                assert part(path) in places, f"{path}:{line}: {package} belongs in {' and '.join(sorted(places))}"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_only_the_command_line_prints(path):
    if part(path) == "cli":
        return
    for node in ast.walk(ast.parse(path.read_text())):
        called = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id
        assert called not in ("print", "input"), f"{path}:{node.lineno}: {called}()"


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("piezoharvest", ("numba", "matplotlib", "control", "pydantic", "scipy", "pyarrow", "h5py")),
        ("piezoharvest.system", ("numba", "matplotlib", "control", "pydantic", "scipy")),
        ("piezoharvest.shunts", ("numba", "matplotlib", "control", "pydantic", "scipy")),
        ("piezoharvest.engine", ("matplotlib", "control", "pydantic")),
        ("piezoharvest.engine.response", ("numba", "matplotlib", "control", "pydantic")),
        ("piezoharvest.cli", ("numba", "matplotlib", "control")),
        ("piezoharvest.sweep", ("numba", "matplotlib", "control", "pyarrow", "distributed", "dask", "scipy.stats")),
    ],
)
def test_import_is_light(module, absent):
    code = f"import sys, {module}; print(*(p for p in {absent!r} if p in sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == []
