"""Compiled code on disk: of the right sources, whole, and no hindrance where there is no place for it."""

import ast
import ctypes
import inspect
import json
import os
import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import pytest
from selection import with_slow

import piezoharvest
from piezoharvest.engine.compilation.cache import sources
from piezoharvest.engine.compilation.compiled import TESTED

PACKAGE = Path(piezoharvest.__file__).parent
STUDY = """
[transducer]
mass = 0.010
damping = 0.0628
stiffness = 986.96
coupling = 1.0e-3
capacitance = 40e-9

[excitation]
kind = "sine_force"
amplitude = 0.02
frequency = 50.6

[[shunts]]
kind = "parallel_sshi"
inductance = 0.1
quality = 5.0
dc_voltage = 3.0
"""
# A function of the engine that is compiled at once, with a number and a function from other files in it.
SMALL = {
    "small.py": """\
from piezoharvest.engine.compilation.compiled import entry
from piezoharvest.engine.below import number as nb
from piezoharvest.equations.terms import SMALL_FACTOR


@entry
def small(x):
    return SMALL_FACTOR * nb.plus(x)
""",
    "below/__init__.py": "",
    "below/number.py": """\
from piezoharvest.engine.compilation.compiled import compiled


@compiled
def plus(x):
    return x + 1.0
""",
}
RUN = "from piezoharvest.engine.small import small; print(small(2.0), sum(small.stats.cache_hits.values()))"
# Several processes find nothing kept before any of them compiles: having looked, each waits for the others.
TOGETHER = """\
import os, sys, time
from piezoharvest.engine.compilation import cache
from piezoharvest.engine.small import small
folder, own, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
look = cache._CodeFiles.load
def look_and_wait(*arguments):
    found = look(*arguments)
    open(os.path.join(folder, own), "w").close()
    while len(os.listdir(folder)) < count:
        time.sleep(0.005)
    return found
cache._CodeFiles.load = look_and_wait
print(small(2.0), sum(small.stats.cache_hits.values()))
"""
UNKEPT = "warning: compiled code cannot be stored on disk ("


def copied(folder):
    """The package elsewhere, with the small function in it."""
    copy = folder / "piezoharvest"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for name, text in SMALL.items():
        path = copy / "engine" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    with (copy / "equations" / "terms.py").open("a") as file:
        file.write("\nSMALL_FACTOR = 3.0\n")
    return copy


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    return copied(tmp_path_factory.mktemp("package"))


@pytest.fixture(scope="module")
def compiled(package, tmp_path_factory):
    """Folder of the code that a first run has kept, to be copied."""
    folder = tmp_path_factory.mktemp("kept")
    assert finish(begin(package, NUMBA_CACHE_DIR=folder)) == ("9.0 0", [])
    return folder


@pytest.fixture
def kept_before(compiled, tmp_path):
    """Such a folder of the test's own."""
    return shutil.copytree(compiled, tmp_path / "kept")


def environment(package, **changes):
    """Environment in which that copy of the package is found; None removes a variable."""
    own = {**os.environ, "PYTHONPATH": str(package.parent), "OMP_NUM_THREADS": "1", "NUMBA_CACHE_DIR": None, **changes}
    return {name: str(value) for name, value in own.items() if value is not None}


def begin(package, code=RUN, *arguments, options=None, **changes):
    command = [sys.executable, "-c", code, *map(str, arguments)]
    place = {"cwd": package.parent, "env": environment(package, **changes), "text": True}
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **place, **(options or {}))


def finish(process):
    """Its output, after it has ended well, and what it said on stderr, by lines."""
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    return out.strip(), err.splitlines()


def imported(tree):
    """Names of modules of this package that a file imports, and of what may be one."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        else:
            continue
        yield from (name for name in names if name.split(".")[0] == "piezoharvest" and is_module(name))


def is_module(name):
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:  # what is above it is no package
        return False


def reached(function):
    """Values that a function finds by its names: globals, those of modules, and in its closure."""
    for code in [function.__code__, *(each for each in function.__code__.co_consts if hasattr(each, "co_names"))]:
        for name in code.co_names:
            yield function.__globals__.get(name)
            for module in filter(inspect.ismodule, map(function.__globals__.get, code.co_names)):
                yield getattr(module, name, None)
    yield from (cell.cell_contents for cell in function.__closure__ or ())


def python_function(value):
    """The function of this package behind what is compiled, or nothing."""
    function = inspect.unwrap(getattr(value, "py_func", getattr(value, "_defn", value)))
    return function if inspect.isfunction(function) and function.__module__.startswith("piezoharvest.") else None


def code_files(folder):
    """All that is kept of the small function."""
    return sorted(path for path in Path(folder).rglob("*") if path.name.startswith("small.small") and path.is_file())


class TestSources:
    @pytest.mark.parametrize("entry", ["engine.entry_point", "predict.propagation.propagate"])
    def test_all_that_compiled_functions_can_be_made_of_is_in_their_stamp(self, entry):
        """Functions and constants come by imports: here as Python itself reads them."""
        module = f"piezoharvest.{entry}"
        found, todo = {}, [module]
        while todo:
            name = todo.pop()
            if name not in found and (spec := find_spec(name)):
                found[name] = spec.origin
                todo += imported(ast.parse(Path(spec.origin).read_text()))
        assert len(found) > 3
        assert set(found.values()) <= set(sources(found[module]))

    def test_all_modules_of_the_functions_compiled_into_an_entry_are_in_its_stamp(self):
        """Whatever way they have come."""
        from piezoharvest.engine.entry_point import engine

        found, todo = set(), [engine.py_func]
        while todo:
            function = todo.pop()
            if function not in found:
                found.add(function)
                todo += [value for value in map(python_function, reached(function)) if value]
        assert len(found) > 100
        assert {function.__code__.co_filename for function in found} <= set(
            sources(engine.py_func.__code__.co_filename)
        )

    def test_tuples_that_compiled_functions_take_are_too(self):
        """The order of their fields is compiled in, and the signature that code is kept under does not show it."""
        from piezoharvest.predict.propagation import arguments, propagate

        assert arguments.__file__ in sources(propagate.__file__)

    def test_pages_and_the_command_line_are_not(self):
        """Or every change of theirs would cost a compilation."""
        parts = {
            Path(path).relative_to(PACKAGE).parts[0] for path in sources(str(PACKAGE / "engine" / "entry_point.py"))
        }
        assert {"engine", "equations"} <= parts
        assert not {"cli", "report", "records", "identify", "diagnose", "design", "sweep"} & parts

    def test_nested_files_and_constants_from_elsewhere_count(self, package):
        found = {str(Path(path).relative_to(package)) for path in within(package, "sources")}
        assert {"engine/small.py", "engine/below/__init__.py", "engine/below/number.py", "equations/terms.py"} <= found
        assert {f"engine/compilation/{name}.py" for name in ("compiled", "pipeline", "cache")} <= found


def within(package, function):
    code = f"import sys; from piezoharvest.engine.compilation.cache import {function} as f; print(*f(sys.argv[1]))"
    return finish(begin(package, code, package / "engine" / "small.py"))[0].split()


class TestKept:
    def test_second_run_takes_the_code_of_the_first(self, package, kept_before):
        (kept,) = code_files(kept_before)
        assert finish(begin(package, NUMBA_CACHE_DIR=kept_before)) == ("9.0 1", [])
        assert code_files(kept_before) == [kept]

    @pytest.mark.slow
    def test_beside_the_source_where_nothing_else_is_said(self, tmp_path):
        package = copied(tmp_path)
        assert finish(begin(package)) == ("9.0 0", [])
        assert [path.parent for path in code_files(tmp_path) if path.suffix == ".nbc"] == [
            package / "engine" / "__pycache__"
        ]
        assert finish(begin(package)) == ("9.0 1", [])

    @pytest.mark.parametrize(
        ("name", "old", "new", "found"),
        [
            ("equations/terms.py", "FACTOR = 3.0", "FACTOR = 4.0", "12.0 0"),
            pytest.param("engine/below/number.py", "x + 1.0", "x + 2.0", "12.0 0", marks=pytest.mark.slow),
        ],
    )
    def test_code_of_other_sources_is_not_run(self, tmp_path, name, old, new, found):
        """Although the file that changes has the size and the time of before, as in a wheel."""
        package = copied(tmp_path)
        assert finish(begin(package, NUMBA_CACHE_DIR=tmp_path / "kept"))[0] == "9.0 0"
        (before,) = code_files(tmp_path / "kept")
        path = package / name
        times = path.stat()
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        for folder in list(package.rglob("__pycache__")):  # Python's own files go by time and size
            shutil.rmtree(folder)
        assert finish(begin(package, NUMBA_CACHE_DIR=tmp_path / "kept"))[0] == found
        (after,) = code_files(tmp_path / "kept")
        assert before != after

    def test_processes_that_compile_at_once(self, package, tmp_path):
        meeting, kept = tmp_path / "meeting", tmp_path / "kept"
        meeting.mkdir()
        together = [begin(package, TOGETHER, meeting, n, 2, NUMBA_CACHE_DIR=kept) for n in range(2)]
        assert [finish(process) for process in together] == [("9.0 0", [])] * 2
        (code,) = code_files(kept)
        assert code.suffix == ".nbc"
        assert finish(begin(package, NUMBA_CACHE_DIR=kept)) == ("9.0 1", [])

    @pytest.mark.parametrize("damage", [pytest.param("short", marks=pytest.mark.slow), "changed"])
    def test_damaged_code_is_made_again(self, package, kept_before, damage):
        (kept,) = code_files(kept_before)
        content = kept.read_bytes()
        middle = len(content) // 2
        kept.write_bytes(
            {
                "short": content[:middle],
                "changed": content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :],
            }[damage]
        )
        assert finish(begin(package, NUMBA_CACHE_DIR=kept_before)) == ("9.0 0", [])
        assert finish(begin(package, NUMBA_CACHE_DIR=kept_before)) == ("9.0 1", [])


def obey_modes():
    """Take from root the privilege to write where the modes of files do not allow it (Linux)."""
    drop, dac_override = 24, 1
    if ctypes.CDLL(None, use_errno=True).prctl(drop, dac_override, 0, 0, 0):
        raise OSError(ctypes.get_errno(), "prctl")


OTHER = {"user": "nobody", "group": "nogroup", "extra_groups": []}


def runs_as_nobody():
    if os.geteuid() != 0:
        return False
    try:
        return subprocess.run([sys.executable, "-c", ""], check=False, **OTHER).returncode == 0
    except (OSError, LookupError):
        return False


def users():
    """Who may not write into the package's folder, with the options of `Popen` for it."""
    if os.geteuid() != 0:
        return [pytest.param({}, id="user")]
    absent = pytest.mark.skipif(not runs_as_nobody(), reason="nobody may not run this interpreter")
    return [pytest.param({"preexec_fn": obey_modes}, id="root"), pytest.param(OTHER, id="nobody", marks=absent)]


@pytest.fixture(scope="module")
def read_only():
    """The package in a folder that all may read and nobody may write into; `closed` beside it is one, too."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        package = copied(folder)
        (folder / "closed").mkdir()
        (folder / "study.toml").write_text(STUDY)
        for path in [folder, *folder.rglob("*")]:
            path.chmod(0o555 if path.is_dir() else 0o444)
        yield package
        for path in [folder, *(path for path in folder.rglob("*") if path.is_dir())]:
            path.chmod(0o755)


@pytest.mark.skipif(sys.platform != "linux", reason="drops privileges as Linux does")
@pytest.mark.parametrize("options", users())
class TestNoPlace:
    @pytest.mark.parametrize(
        "variable",
        [
            pytest.param(None, id="none"),
            pytest.param("closed", id="closed", marks=pytest.mark.slow),
            pytest.param("study.toml", id="file"),
        ],
    )
    def test_compiled_in_memory_with_one_sentence(self, read_only, options, variable):
        closed = read_only.parent / "closed"
        places = {"HOME": closed, "XDG_CACHE_HOME": None, "NUMBA_CACHE_DIR": variable and read_only.parent / variable}
        found, said = finish(begin(read_only, options=options, **places))
        assert found == "9.0 0"
        assert len(said) == 1
        assert said[0].startswith(UNKEPT)
        assert "set the environment variable NUMBA_CACHE_DIR to a writable directory" in said[0]

    @pytest.mark.slow
    def test_a_folder_that_is_closed_meanwhile(self, read_only, options, tmp_path_factory):
        with tempfile.TemporaryDirectory() as name:
            Path(name).chmod(0o777)
            code = f"import os; from piezoharvest.engine.small import small; os.chmod({name!r} + '/k', 0o555)\n{RUN}"
            folder = Path(name, "k")
            code = code.replace("/k'", "/k/' + os.listdir(" + repr(str(folder)) + ")[0]")
            found, said = finish(begin(read_only, code, options=options, HOME=name, NUMBA_CACHE_DIR=folder))
        assert (found, len(said)) == ("9.0 0", 1)
        assert said[0].startswith(f"{UNKEPT}[Errno 13] Permission denied")

    def test_a_user_without_a_home(self, read_only, options):
        """Nothing of the name ~ is made where it runs."""
        with tempfile.TemporaryDirectory() as name:
            Path(name).chmod(0o777)
            code = f"import os; os.chdir({name!r}); os.path.expanduser = lambda path: path\n{RUN}"
            found, said = finish(begin(read_only, code, options=options, HOME=None, XDG_CACHE_HOME=None))
            assert os.listdir(name) == []
        assert (found, len(said)) == ("9.0 0", 1)

    @pytest.mark.slow
    def test_a_simulation(self, read_only, options):
        code = "import sys; from piezoharvest.cli import main; sys.exit(main(sys.argv[1:]))"
        closed = read_only.parent / "closed"
        places = {"HOME": closed, "XDG_CACHE_HOME": None, "NUMBA_CACHE_DIR": None}
        out, said = finish(begin(read_only, code, "simulate", "study.toml", "--json", options=options, **places))
        (result,) = json.loads(out)["results"]
        assert result["converged"] is True
        assert result["harvested_power"] > 0
        assert len(said) == 1
        assert said[0].startswith(UNKEPT)


class TestOtherNumba:
    @pytest.mark.parametrize(
        "version", with_slow(["0.60.0", "0.99.1", "0+unknown"], slow=lambda version: version != "0.99.1")
    )
    def test_compiled_plainly_with_one_sentence(self, package, tmp_path, version):
        code = f"import numba; numba.__version__ = {version!r}\n{RUN}"
        found, said = finish(begin(package, code, NUMBA_CACHE_DIR=tmp_path))
        assert found == "9.0 0"
        assert len(said) == 1
        assert said[0].startswith(f"warning: this version of piezoharvest does not know numba {version} ")
        assert code_files(tmp_path) == []

    def test_this_one_is_among_those_tested(self):
        import numba

        version = tuple(map(int, numba.__version__.split(".")[:2]))
        assert TESTED[0] <= version <= TESTED[1]
