"""What pyproject.toml says of the package's dependencies."""

import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

import piezoharvest
from piezoharvest.description import effects, shunts
from piezoharvest.engine.compilation.compiled import TESTED

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
DEPENDENCIES, TEST = PROJECT["dependencies"], PROJECT["optional-dependencies"]["test"]
EXTRAS = PROJECT["optional-dependencies"]
# Of single uses and formats, imported where they are asked for.
OPTIONAL = [part for extra in ("cluster", "explore", "notebook", "rf", "tdms", "uff") for part in EXTRAS[extra]]


def normal(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def imported(folder):
    """Packages that the files of a folder import, wherever in a file, but for this one and those of Python."""
    found = set()
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                found.add(node.module.split(".")[0])
    return found - set(sys.stdlib_module_names) - {"piezoharvest"}


def test_what_is_imported_is_declared():
    homes = packages_distributions()
    declared = {normal(re.match(r"[\w.-]+", dependency)[0]) for dependency in (*DEPENDENCIES, *OPTIONAL)}
    packages = imported(Path(piezoharvest.__file__).parent)
    assert {"cvxpy", "numba", "numpy"} <= packages
    missing = {name for name in packages if not declared & set(map(normal, homes.get(name, [name])))}
    assert missing == set()


def test_the_extra_all_is_all_that_the_package_imports():
    named = re.fullmatch(r"piezoharvest\[(.+)\]", *EXTRAS["all"])[1].split(",")
    assert {part for extra in named for part in EXTRAS[extra]} == set(OPTIONAL)


def test_type_checkers_see_every_public_name():
    """The stub names what the package loads lazily, each from where it is loaded, and nothing else."""
    stub = ast.parse((Path(piezoharvest.__file__).parent / "__init__.pyi").read_text())
    homes, exported = {}, []
    for node in stub.body:
        if isinstance(node, ast.ImportFrom):
            homes |= {alias.name: (node.module or "").removeprefix("piezoharvest.") for alias in node.names}
        elif isinstance(node, ast.Assign):
            exported = ast.literal_eval(node.value)
    assert homes == piezoharvest._HOME
    assert sorted(exported) == sorted([*piezoharvest.__all__, "__version__"])


def test_lowest_versions_are_the_bounds():
    wanted = {dependency.replace(">=", "==") for dependency in (*DEPENDENCIES, *TEST)}
    lines = (ROOT / ".ci" / "lowest.txt").read_text().splitlines()
    assert [line for line in lines if not line.startswith("#")] == sorted(wanted)


@pytest.mark.parametrize("dependency", [*DEPENDENCIES, *TEST, *OPTIONAL])
def test_every_dependency_has_a_lower_bound_and_no_other(dependency):
    """An upper one would keep users from what is mended upstream."""
    assert re.fullmatch(r"[\w-]+>=[\d.]+", dependency)


def test_versions_of_numba_are_those_that_its_internals_were_tested_with():
    (line,) = [line for line in (ROOT / "pyproject.toml").read_text().splitlines() if '"numba>=' in line]
    first, last = (".".join(map(str, version)) for version in TESTED)
    assert f'"numba>={first}", # {first} to {last} are tested' in line


def test_former_names_of_modules_are_the_same_modules():
    code = (
        "from piezoharvest.shunts import LinearShunt; from piezoharvest.parameters import quantity;"
        "import piezoharvest.circuit, piezoharvest.description.shunts as new;"
        "assert new.LinearShunt is LinearShunt;"
        "assert piezoharvest.circuit.State.__module__ == 'piezoharvest.description.circuit'"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_top_level_offers_public_names_only():
    assert set(dir(piezoharvest)) == {*piezoharvest.__all__, "__version__"}
    assert {"design", "identify", "diagnose", "load_campaign", "Creep", "SECE", "simulate"} <= set(piezoharvest.__all__)
    for name in piezoharvest.__all__:
        assert callable(getattr(piezoharvest, name)), name


def test_every_shunt_and_effect_of_the_package_is_public():
    classes = [*shunts.registered().values(), *effects.registered().values()]
    own = {cls.__name__ for cls in classes if cls.__module__.startswith("piezoharvest.")}
    assert own <= set(piezoharvest.__all__)


def test_a_package_is_called_as_the_function_of_its_name():
    code = (
        "import dataclasses, piezoharvest, piezoharvest.design.search;"
        "from piezoharvest import design, load_study; from piezoharvest.study import DesignOptions;"
        "assert callable(design) and design.search.design.__name__ == 'design';"
        "study = load_study('designs/stack-load/study.toml');"
        "quick = dataclasses.replace(study, design=DesignOptions(candidates=('resistor',)));"
        "assert design(quick).best.converged"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
