"""Data flows one way: every import of the package points down the list, and heavy packages stay where they belong."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import piezoharvest

ROOT = Path(piezoharvest.__file__).parent
# From the bottom to the top; what stands in one line does not know of each other. A folder stands for all in it; the
# front of a package, its `__init__`, above all its parts.
LAYERS = [
    {
        "callable_package",
        "counting",
        "field_help",
        "former_names",
        "input",
        "near_names",
        "notebook",
        "progress",
        "threads",
    },
    {"description.circuit", "description.parameters"},
    {"readers"},
    {"description.excitation", "description.hysteresis", "description.netlist"},
    {"description.spice_language"},
    {"description.shunts"},
    {"description.protocol"},
    {"description.effects"},
    {"description.diode"},
    {"description.catalogue"},
    {"description.figures"},
    {"description.transducer"},
    {
        "description.limits",
        "description.modes_file",
        "description.paths",
        "description.system",
        "description.tolerance",
    },
    {"equations.laws", "equations.pieces"},
    {"equations.terms"},
    {"equations.rows"},
    {"equations.circuits"},
    {"linear", "engine.compilation", "engine.response"},
    {"engine.memory"},
    {"engine.work_limit"},
    {"engine.lowering", "engine.motion"},
    {"engine.events", "engine.plausibility"},
    {"engine.propagation"},
    {"engine.steady_state"},
    {"engine.entry_point"},
    {"engine.run"},
    {"engine.steady_search"},
    {"engine.batch_means"},
    {"engine.simulation"},
    {"engine.batch", "engine.sensitivity", "engine.windows"},
    {"engine.transient"},
    {"spice"},
    {"effect_files", "study", "output"},
    {"whole_folder"},
    {"specimen", "records.finding", "records.gate", "records.harmonics"},
    {"records.bench_limits", "records.record", "records.weights"},
    {"records.campaign", "records.power", "records.spectra"},
    {"records.errors"},
    {"records.reading"},
    {"records.expectation", "records.recognition"},
    {"records.checks"},
    {"records.loading"},
    {"records.specimens"},
    {"bench.devices", "bench.solver", "exchange", "predict"},
    {"bench.effects"},
    {"bench.settings"},
    {"bench.sensors"},
    {"bench.measuring"},
    {"bench.writing"},
    {"workers"},
    {"identify.noise", "design", "sweep"},
    {"identify.frequency"},
    {"identify.fitting"},
    {
        "identify.confidence",
        "identify.hysteresis",
        "identify.identifiability",
        "identify.preparation",
        "identify.resonance_figures",
        "identify.saving",
    },
    {"identify.result", "identify.start_values"},
    {"identify.growing_fit", "identify.parameter_selection", "identify.residual_quality"},
    {"identify.identification"},
    {"identify.prediction_overlay"},
    {"diagnose"},
    {"population"},
    {"fleet"},
    {"report"},
    {"demo", "explore"},
    {"cli"},
    {"__main__"},
]
RANK = {name: rank for rank, layer in enumerate(LAYERS) for name in layer}
# Packages that only these parts may use, wherever in a file the import stands.
ONLY = {
    "numba": {"engine", "predict"},
    "scipy.integrate": {"engine"},
    "matplotlib": {"report", "notebook"},
    "pandas": {"notebook"},
    "jinja2": {"report"},
    "bokeh": {"explore"},
    "tornado": {"explore"},
    "dask": {"workers"},
    "distributed": {"workers"},
    "typer": {"cli"},
    "rich": {"cli"},
    "pydantic": {"study", "records", "bench"},
}
FILES = sorted(ROOT.rglob("*.py"))


def part(path):
    """Top-level part of the package that a file belongs to."""
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def place(dotted):
    """Name in the order under which a module stands: its own, that of a folder about it, or its package's."""
    words = dotted.split(".")
    known = (".".join(words[:count]) for count in range(len(words), 0, -1))
    return next((name for name in known if name in RANK), words[0])


def rank(name):
    """Place in the order; a front stands above all parts of its package."""
    return RANK[name] if name in RANK else max(RANK[other] for other in RANK if other.startswith(f"{name}.")) + 0.5


@cache
def nodes(path):
    """All parts of the syntax tree of a file."""
    return list(ast.walk(ast.parse(path.read_text())))


def imports(path):
    """Full names of all that a file imports, within functions too."""
    for node in nodes(path):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: imports are absolute here"
            yield from ((f"{node.module}.{alias.name}", node.lineno) for alias in node.names)


def every(faults, files=None):
    """What a check finds in all files: one test for them, as six hundred would take longer to collect than to run."""
    return [fault for path in (FILES if files is None else files) for fault in faults(path)]


def upwards(path):
    dotted = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    if path.name == "__init__.py" and dotted.removesuffix(".__init__") not in RANK:
        return  # a front, which offers what is in its parts
    own = place(dotted)
    if own not in RANK:
        yield f"{own} has no place in the order: give it one in {__file__}"
        return
    for name, line in imports(path):
        if not name.startswith("piezoharvest.") or name == "piezoharvest.__version__":
            continue
        used = place(name.removeprefix("piezoharvest."))
        if used != own and not rank(used) < rank(own):
            yield f"{path}:{line}: {own} imports {used}, which is not below it"


def test_imports_point_downwards():
    assert every(upwards) == []


def test_no_folder_has_more_files_than_one_overlooks():
    for folder in {path.parent for path in FILES}:
        assert len(list(folder.glob("*.py"))) <= 14, folder


def asked_of_the_whole(path):
    for node in nodes(path):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "piezoharvest":
            yield f"{path}:{node.lineno}: piezoharvest.{node.attr}", node.attr


def test_the_whole_package_is_asked_for_its_version_only():
    """What else it offers comes from above, by way of its front."""
    asked = every(asked_of_the_whole)
    assert "__version__" in [name for _, name in asked]
    assert [where for where, name in asked if name != "__version__"] == []


@pytest.mark.parametrize("path", [path for path in FILES if "engine" in path.parts], ids=lambda path: path.stem)
def test_the_engine_knows_no_shunt_by_name(path):
    """What it needs to know of one, the shunt itself says."""
    general = ("base", "cold_start", "curves", "saturation", "stored")  # all shunts, and what is put around any of them
    for name, line in imports(path):
        if name.startswith("piezoharvest.description.shunts"):
            assert name.split(".")[3] in general, f"{path}:{line}: imports {name}"


def strayed(path):
    for name, line in imports(path):
        for package, places in ONLY.items():
            if (name == package or name.startswith(package + ".")) and part(path) not in places:
                yield f"{path}:{line}: {package} belongs in {' and '.join(sorted(places))}"


def test_heavy_packages_stay_where_they_belong():
    assert every(strayed) == []


def printed(path):
    for node in nodes(path):
        called = isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id
        if called in ("print", "input"):
            yield f"{path}:{node.lineno}: {called}()"


def test_only_the_command_line_prints():
    assert every(printed, [path for path in FILES if part(path) == "cli"]) != []  # it is found where it is
    assert every(printed, [path for path in FILES if part(path) not in ("cli", "__main__")]) == []


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("piezoharvest", ("numba", "matplotlib", "control", "pydantic", "scipy", "pyarrow", "h5py")),
        ("piezoharvest.description.system", ("numba", "matplotlib", "control", "pydantic", "scipy")),
        ("piezoharvest.description.shunts", ("numba", "matplotlib", "control", "pydantic", "scipy")),
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
