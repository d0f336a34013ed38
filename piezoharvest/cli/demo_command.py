"""The command `demo`, once its arguments are parsed."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from piezoharvest.cli.commands import run_design
from piezoharvest.cli.notes import telling
from piezoharvest.output import check_directory, check_new_directory, write_text
from piezoharvest.study import load_study, read_toml


def demo(out: Path) -> int:
    """Design the study that comes with the package, tell what becomes of it on the bench, and print the page's path."""
    from piezoharvest.demo.page import answer, write_story
    from piezoharvest.demo.story import tell

    check_new_directory(out)
    shipped = resources.files("piezoharvest").joinpath("demo")
    study = check_directory(out, create=True) / "study.toml"
    write_text(shipped.joinpath("study.toml").read_text(encoding="utf-8"), study)
    result = run_design(load_study(study), as_json=False, report=out / "design")
    with resources.as_file(shipped.joinpath("bench.toml")) as path:
        bench = read_toml(path)
    with telling() as progress:
        story = tell(study, bench, result, out, progress)
    print(answer(story))
    print(write_story(story, out))
    return 0 if result.converged and story.converged else 1
