"""The report of a design: what is on the page, what lies beside it, and what is left out where it makes no sense."""

import dataclasses
import re
import shutil

import pytest
from pages import figures_on_the_page_only
from report_studies import Page, designed, page_of, pictures, untrusted_report

from piezoharvest.output import OutputError
from piezoharvest.report import gallery, write_report


class TestContents:
    def test_answer_is_the_best_candidate(self):
        page = Page(page_of("bench")).text
        assert "Best of 5: series RL" in page
        assert "harvests 796 µW" in page
        assert "under a sinusoidal base acceleration of 2 m/s² at 50.6 Hz" in page

    def test_limit_is_marked(self):
        """(m a)^2/(8 b) = (0.01 * 2)^2/(8 * 0.0628) = 796 uW, which a matched series RL reaches at resonance."""
        page = Page(page_of("bench")).text
        assert re.search(r"can draw more than 796 µW", page)
        assert "(m a)²/(8 b)" in page

    @pytest.mark.slow
    def test_band(self):
        page = Page(page_of("band")).text
        assert "from 48 Hz to 53 Hz (worst vibration)" in page
        assert re.search(r"Best of 2: \w+ .*lowers the vibration by [0-9.]+ dB", page)

    def test_two_port_and_parameters(self):
        page = Page(page_of("bench")).text
        for expected in ("50.000 Hz", "50.629 Hz", "0.0253", "50.0", "1.27", "40 nF", "987 N/m", "10 g"):
            assert expected in page, expected
        assert "clamped capacitance C" in page

    @pytest.mark.slow
    def test_hysteresis_gives_both_operating_points(self):
        page = Page(page_of("stack")).text
        assert "hysteresis slipping" in page
        assert "hysteresis sticking" in page
        assert "describing function" in page

    def test_transient_says_so(self):
        page = Page(page_of("step")).text
        assert "From rest." in page
        assert "under the step force of the study" in page

    @pytest.mark.slow
    def test_noise_has_the_power_that_it_brings_in(self):
        """S m^2/(4 m) = 0.1 * 0.01/4 = 250 uW, whatever the shunt."""
        assert "250 µW" in Page(page_of("noise")).text

    def test_switch_instants_are_marked(self):
        source = page_of("bench").read_text()
        start = source.index('id="figure-waveforms-', source.index("parallel SSHI</h3>") - 200)
        assert "waveforms-" in source[start:]
        assert any("parallel-sshi" in file for file in pictures(page_of("bench")))

    def test_the_same_input_gives_the_same_page(self, tmp_path):
        """In a directory that is made, in which nothing else is left."""
        with figures_on_the_page_only():
            again = write_report(*designed("step"), str(tmp_path / "new" / "folder"))
        assert again == tmp_path / "new" / "folder" / "report.html"
        assert again.read_text() == page_of("step").read_text()
        assert {file.suffix for file in again.parent.iterdir()} == {".html", ".png", ".pdf"}


class TestUntrusted:
    def test_is_shown_as_such(self):
        page = Page(untrusted_report())
        rows = [row for row in page.all("tr") if "data-kind" in row]
        assert [row["data-converged"] for row in rows] == ["false", "true", "true", "true", "false"]
        assert page.text.count("not converged") == 2
        assert "Not to be trusted: no steady state: the periodic solution is unstable" in page.text
        assert [p for p in page.all("p") if p.get("role") == "alert"]
        assert "voltage too high" in page.text

    def test_what_failed_has_no_bar_and_no_waveforms(self):
        page = Page(untrusted_report())
        bars = page.source[page.source.index('id="figure-energy"') :]
        assert len(re.findall(r'<tr><th scope="row">', bars[: bars.index("How the candidates")])) == 4

    def test_a_best_candidate_that_breaks_a_limit(self, tmp_path):
        study, result = designed("step")
        broken = tuple(dataclasses.replace(c, violates=("min_power",)) for c in result.candidates)
        with figures_on_the_page_only():
            page = Page(write_report(study, dataclasses.replace(result, candidates=broken), tmp_path))
        assert "No candidate meets all limits; this one violates min_power." in page.text


class TestFiles:
    def test_a_report_is_replaced_as_a_whole(self, tmp_path, monkeypatch):
        shutil.copytree(page_of("step").parent, tmp_path, dirs_exist_ok=True)
        path = tmp_path / page_of("step").name
        before = path.read_text()

        def fail(*_):
            raise RuntimeError("killed")

        monkeypatch.setattr(gallery.Gallery, "_bode", fail)
        study, result = designed("step")
        with pytest.raises(RuntimeError), figures_on_the_page_only():
            write_report(dataclasses.replace(study, title="another"), result, tmp_path)
        assert path.read_text() == before
        assert not [file for file in tmp_path.iterdir() if ".part" in file.name]

    def test_where_it_cannot_be_written(self, tmp_path):
        (tmp_path / "file").write_text("")
        with pytest.raises(OutputError, match="file"):
            write_report(*designed("step"), tmp_path / "file")
