"""One random mutant of the physics, the event code or the likelihood: killed where a quick test of its part fails.

The operators are those of cosmic-ray (the extra `mutation`). A mutant stands in a copy of the tree, under `build/`, and
has a copy of the cache of compiled code: what is compiled of it is used for no other one.
"""

from __future__ import annotations

import ast
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from functools import lru_cache
from pathlib import Path
from typing import Any

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

ROOT = Path(__file__).parents[2]
TREE, CACHE, OWN_CACHE = (ROOT / "build" / "mutants" / name for name in ("tree", "cache", "own_cache"))
LEFT_OUT = shutil.ignore_patterns(".*", "build", "__pycache__", "*.jsonl", "demo-report")
# Without those that raise a TypeError wherever they are tried, as `<<` of floats: to see these is no merit of a test.
OPERATORS = re.compile(
    r"core/(Replace(BinaryOperator_((Add|Sub|Mul|Div|Pow)_(Add|Sub|Mul|Div)|BitOr_BitAnd|BitAnd_BitOr)"
    r"|ComparisonOperator_((Eq|NotEq|LtE?|GtE?)_(Eq|NotEq|LtE?|GtE?)|Is_IsNot|IsNot_Is|In_NotIn|NotIn_In)"
    r"|UnaryOperator_(USub_UAdd|Delete_Not)|TrueWithFalse|FalseWithTrue|AndWithOr|OrWithAnd|BreakWithContinue"
    r"|ContinueWithBreak)|AddNot|NumberReplacer|ZeroIterationForLoop)"
)
# Quick tests of each part, the quickest first.
FITS = ("identify/test_noise_limits", "identify/test_tones", "identify/test_shared_equations",
        "identify/test_fit_parts", "identify/test_denoise", "identify/test_data", "identify/test_measured_responses",
        "identify/test_identify", "identify/test_loops", "identify/test_circuit_records")  # fmt: skip
MOTIONS = ("engine/test_event_parts", "engine/test_equilibrium", "engine/test_scales", "test_hysteresis",
           "engine/test_steady_states", "engine/test_extraction", "engine/test_trajectories",
           "engine/test_linear_shunts", "engine/test_vector", "engine/test_trust", "engine/test_many",
           "literature/test_harvesting", "literature/test_switched_damping", "shunts/test_diode",
           "engine/test_limits")  # fmt: skip
TESTS: dict[str, tuple[str, ...]] = {
    "equations": ("conformance/test_one_physics", "test_linear", *MOTIONS),
    **dict.fromkeys(("engine/events", "engine/motion", "engine/steady_state", "engine/lowering"), MOTIONS),
    **dict.fromkeys(("identify/fitting", "identify/noise"), FITS),
}
COMPILATION = 120.0  # s, which all compiled code takes at most where it is changed


def attempt_mutant(seed: int) -> dict[str, Any]:
    """What became of the mutant of a seed.

    Returns
    -------
    dict
        `seed`, `kind` (the module), `line`, `operator`, `outcome` ("killed", "survived", "timeout"), `what` (the line
        before and after), `test` that failed first and `seconds`.

    Raises
    ------
    RuntimeError
        The tests fail without any mutant.
    """
    place, line, operator, original, code = drawn(seed)
    limit = 3.0 * _undisturbed(place.parent) + COMPILATION
    shutil.rmtree(OWN_CACHE, ignore_errors=True)
    shutil.copytree(CACHE, OWN_CACHE, copy_function=os.link)  # a file that is cached is replaced, never written into
    begin, module = time.monotonic(), TREE / place
    try:
        module.write_text(code, encoding="utf-8")
        passed, failed = _tested(place.parent, OWN_CACHE, limit)
    finally:
        module.write_text(original, encoding="utf-8")
    outcome = {True: "survived", False: "killed", None: "timeout"}[passed]
    before, after = (text.splitlines()[line - 1].strip() for text in (original, code))
    return {"seed": seed, "kind": str(place), "line": line, "operator": operator, "outcome": outcome,
            "what": f"{before} -> {after}", "test": failed, "seconds": round(time.monotonic() - begin, 1)}  # fmt: skip


def drawn(seed: int) -> tuple[Path, int, str, str, str]:
    """Module, line, operator, code before and after: a place is drawn first, then what may stand there instead."""
    rng = random.Random(seed)
    while True:
        *where, mutants = rng.choice(_places())
        place, line = where
        name, occurrence = rng.choice(mutants)
        original = (ROOT / place).read_text(encoding="utf-8")
        code = mutate_code(original, get_operator(name)(), occurrence)
        if _meaning(code) not in (None, _meaning(original)):
            return place, line, name.removeprefix("core/"), original, code


@lru_cache
def _places() -> list[tuple[Path, int, list[tuple[str, int]]]]:
    """All places in the parts, with the line of each and what operators do there."""
    found: dict[tuple[Path, int, int], list[tuple[str, int]]] = {}
    names = [name for name in operator_names() if OPERATORS.fullmatch(name)]
    for path in sorted(path for part in TESTS for path in (ROOT / "piezoharvest" / part).rglob("*.py")):
        nodes = list(ast_nodes(get_ast(path.read_text(encoding="utf-8"))))
        for name in names:
            starts = [start for node in nodes for start, _ in get_operator(name)().mutation_positions(node)]
            for occurrence, start in enumerate(starts):
                found.setdefault((path.relative_to(ROOT), *start), []).append((name, occurrence))
    return [(path, line, mutants) for (path, line, _), mutants in found.items()]


def _meaning(code: str) -> str | None:
    """Syntax tree of code without annotations, which nothing runs; None of what is no code."""
    try:
        tree = ast.parse(code)
    except SyntaxError:
        return None
    for node in ast.walk(tree):
        if isinstance(node, ast.arg | ast.AnnAssign):
            vars(node)["annotation"] = None
        elif isinstance(node, ast.FunctionDef):
            node.returns = None
    return ast.dump(tree)


@lru_cache
def _undisturbed(folder: Path) -> float:
    """Duration of the tests of a part without a mutant, s; the cache is filled, and the copy of the tree made anew."""
    _copy()
    for _ in range(2):  # once more, when all is compiled
        begin = time.monotonic()
        passed, failed = _tested(folder, CACHE, None)
        if not passed:
            raise RuntimeError(f"{folder}: {failed or 'its tests'} failed without a mutant")
        if time.monotonic() - begin < COMPILATION:
            break
    return time.monotonic() - begin


@lru_cache
def _copy() -> None:
    shutil.rmtree(TREE, ignore_errors=True)
    shutil.copytree(ROOT, TREE, ignore=LEFT_OUT)
    CACHE.mkdir(exist_ok=True)


def _tested(folder: Path, cache: Path, limit: float | None) -> tuple[bool | None, str]:
    """Whether the tests of a part pass (None: not within the limit, s), and the one that fails first."""
    files = [f"tests/{name}.py" for name in TESTS[str(folder.relative_to("piezoharvest"))]]
    line = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-m",
            "not slow and not spice and not browser", *files]  # fmt: skip
    own = {"PYTHONPATH": str(TREE), "NUMBA_CACHE_DIR": str(cache), "PYTHONDONTWRITEBYTECODE": "1", "CI": "true"}
    process = subprocess.Popen(line, cwd=TREE, env={**os.environ, **own}, stdout=subprocess.PIPE, text=True,
                               stderr=subprocess.STDOUT, start_new_session=True)  # fmt: skip
    try:
        said = process.communicate(timeout=limit)[0]
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)  # what the tests have started, too
        process.communicate()
        return None, ""
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", said, re.MULTILINE)
    return process.returncode == 0, failed[1] if failed else ""
