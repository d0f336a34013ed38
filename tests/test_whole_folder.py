"""Folders that are replaced as a whole: killed at every step, the old result is there or the new one."""

from __future__ import annotations

import os
import signal
import stat
import sys
import traceback

import pytest

from piezoharvest import whole_folder as module
from piezoharvest.output import OutputError
from piezoharvest.report.frame.report_folder import report_folder
from piezoharvest.whole_folder import whole_folder

PAGE = "report.html"
FRAME = '<meta name="generator" content="piezoharvest 0">{}{}'
OLD = {"a.png": "old a", "b.png": "old b"}
NEW = {"b.png": "new b", "c & d.png": "new c"}
# Children of a process with threads may only do what needs none of them, as here.
pytestmark = pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")
posix = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are killed as POSIX systems do")


def page(figures, word):
    """A page as the templates write it: its mark, and the names of its figures."""
    names = "".join(f'<span class="file">{name.replace("&", "&amp;")}</span>' for name in figures)
    return FRAME.format(names, word)


def whole(figures, word):
    return {**figures, PAGE: page(figures, word)}


def write(folder, figures, word):
    with report_folder(folder) as new:
        for name, text in whole(figures, word).items():
            (new / name).write_text(text)


def found(folder):
    """Contents of the files in a folder, by name; hidden ones left out."""
    return {each.name: each.read_text() for each in folder.iterdir() if each.is_file() and each.name[0] != "."}


def hidden(*folders):
    return [each.name for folder in folders for each in folder.iterdir() if each.name.startswith(".")]


def without_exchange(monkeypatch):
    """A system that cannot exchange two folders at one stroke."""

    def refuse(*_):
        raise OSError("no such call")

    monkeypatch.setattr(module, "_swap", refuse)


def killed_at(step, work):
    """True if the work, done in another process, was killed when it asked the system for the `step`-th time."""
    child = os.fork()
    if child == 0:
        left = step

        def count(event, _):
            nonlocal left
            if event.startswith(("os.", "shutil.", "open", "fcntl.", "ctypes.")):
                left -= 1
                if left == -1:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(count)
        try:
            work()
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert status in (0, -signal.SIGKILL)
    return status != 0


def test_a_new_folder_with_those_above_it(tmp_path):
    write(tmp_path / "new" / "folder", NEW, "new")
    assert found(tmp_path / "new" / "folder") == whole(NEW, "new")
    assert hidden(tmp_path, tmp_path / "new", tmp_path / "new" / "folder") == []


@pytest.mark.parametrize("exchange", [True, False])
def test_nothing_of_an_earlier_report_stays(tmp_path, monkeypatch, exchange):
    if not exchange:
        without_exchange(monkeypatch)
    write(tmp_path / "out", OLD, "old")
    (tmp_path / "out").chmod(0o750)
    write(tmp_path / "out", NEW, "new")
    assert found(tmp_path / "out") == whole(NEW, "new")
    assert hidden(tmp_path, tmp_path / "out") == []
    assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == 0o750


def test_it_is_one_step_where_the_system_has_it(tmp_path):
    """The folder is another one afterwards, and there was no moment without one."""
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name).touch()
    try:
        module._swap(tmp_path / "one", tmp_path / "other")
    except OSError as error:
        pytest.skip(f"not on this system: {error}")
    assert (tmp_path / "one" / "other").exists()
    assert (tmp_path / "other" / "one").exists()


@posix
@pytest.mark.parametrize("exchange", [True, False])
def test_killed_at_every_step(tmp_path, monkeypatch, exchange):
    """What is there is the old report or the new one; without the call of the system the next run gives it back."""
    if not exchange:
        without_exchange(monkeypatch)
    out, seen, step = tmp_path / "out", set(), 0
    while True:
        write(out, OLD, "old")
        if not killed_at(step, lambda: write(out, NEW, "new")):
            break
        if exchange:
            seen.add("old" if found(out) == whole(OLD, "old") else "new")
            assert found(out) in (whole(OLD, "old"), whole(NEW, "new")), step
        with pytest.raises(RuntimeError), report_folder(out):  # a run that fails gives back what a killed one has moved
            assert found(out) in (whole(OLD, "old"), whole(NEW, "new")), step
            raise RuntimeError
        assert hidden(tmp_path, out) == [], step
        step += 1
    assert found(out) == whole(NEW, "new")
    assert step > 10
    assert seen == ({"old", "new"} if exchange else set())


@posix
def test_killed_among_files_of_others(tmp_path):
    """They stay; each file of the report is whole, and the next run mends what was left between two reports."""
    mine = {"data.csv": "1", "mine.png": "picture", "notes.html": "text"}
    step = 0
    while True:
        write(tmp_path, OLD, "old")
        for name, text in mine.items():
            (tmp_path / name).write_text(text)
        ended = not killed_at(step, lambda: write(tmp_path, NEW, "new"))
        now = found(tmp_path)
        assert mine.items() <= now.items(), step
        assert now[PAGE] in (page(OLD, "old"), page(NEW, "new"))
        if now[PAGE] == page(NEW, "new"):  # which is put there last
            assert NEW.items() <= now.items(), step
        assert (now.items() - mine.items()) <= whole(OLD, "old").items() | whole(NEW, "new").items()
        write(tmp_path, NEW, "new")
        assert found(tmp_path).items() >= (mine | whole(NEW, "new")).items()
        assert hidden(tmp_path) == []
        if ended:
            break
        step += 1
    assert step > 10


def test_files_of_others_stay_and_so_does_the_folder(tmp_path):
    out = tmp_path / "out"
    (out / "kept").mkdir(parents=True)
    (out / "kept" / "cache.arrow").write_text("rows")
    (out / "a.png").write_text("not of the page that comes")
    inode = out.stat().st_ino
    write(out, NEW, "new")
    assert found(out) == {"a.png": "not of the page that comes", **whole(NEW, "new")}
    write(out, {"e.png": "e"}, "third")
    assert found(out) == {"a.png": "not of the page that comes", **whole({"e.png": "e"}, "third")}
    assert (out / "kept" / "cache.arrow").read_text() == "rows"
    assert out.stat().st_ino == inode
    assert hidden(tmp_path, out) == []


def test_a_page_of_somebody_else_names_nothing_that_may_go(tmp_path):
    (tmp_path / PAGE).write_text('<span class="file">a.png</span>')
    (tmp_path / "a.png").write_text("mine")
    write(tmp_path, NEW, "new")
    assert found(tmp_path) == {"a.png": "mine", **whole(NEW, "new")}


def test_the_folder_one_stands_in_stays_that_folder(tmp_path, monkeypatch):
    write(tmp_path / "out", OLD, "old")
    monkeypatch.chdir(tmp_path / "out")
    write(".", NEW, "new")
    assert sorted(os.listdir(".")) == sorted(whole(NEW, "new"))
    assert found(tmp_path / "out") == whole(NEW, "new")


def test_a_link_to_a_folder_stays_one(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "out").symlink_to("elsewhere")
    write(tmp_path / "out", NEW, "new")
    assert (tmp_path / "out").is_symlink()
    assert found(tmp_path / "elsewhere") == whole(NEW, "new")


def test_an_error_leaves_what_was_there(tmp_path):
    write(tmp_path / "out", OLD, "old")
    with pytest.raises(RuntimeError), report_folder(tmp_path / "out") as new:
        (new / PAGE).write_text("half")
        raise RuntimeError
    assert found(tmp_path / "out") == whole(OLD, "old")
    with pytest.raises(RuntimeError), report_folder(tmp_path / "never"):
        raise RuntimeError
    assert os.listdir(tmp_path) == ["out"]


def test_an_error_names_the_folder_that_was_asked_for(tmp_path):
    with pytest.raises(OutputError) as raised, report_folder(tmp_path / "out") as new:
        raise OutputError(f"{new / 'a.png'}: cannot be written (No space left on device)")
    assert str(raised.value) == f"{tmp_path / 'out' / 'a.png'}: cannot be written (No space left on device)"
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OutputError, match="file"):
        write(tmp_path / "file", NEW, "new")
    (tmp_path / "taken" / PAGE).mkdir(parents=True)
    with pytest.raises(OutputError, match=r"taken: cannot be written \(Is a directory\)"):
        write(tmp_path / "taken", NEW, "new")
    assert hidden(tmp_path, tmp_path / "taken") == []


@posix
def test_what_a_living_run_writes_is_not_taken_for_left(tmp_path):
    with report_folder(tmp_path / "out") as new:
        (new / PAGE).write_text("first")
        child = os.fork()
        if child == 0:
            write(tmp_path / "out", OLD, "other")
            os._exit(0)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
        assert found(tmp_path / "out") == whole(OLD, "other")
        assert new.exists()
    assert found(tmp_path / "out") == {PAGE: "first"}  # whoever ends last
    assert hidden(tmp_path) == []


def test_any_kind_of_result(tmp_path):
    """What belongs to an earlier one is said by who writes it."""
    for word in ("old", "new"):
        with whole_folder(tmp_path / "out", "index", lambda _: {"index", "old"}) as new:
            (new / "index").write_text(word)
            (new / word).touch()
    assert sorted(os.listdir(tmp_path / "out")) == ["index", "new"]
