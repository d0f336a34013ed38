"""Files of laws without a name that a diagnosis has found."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from piezoharvest.cli.notes import note

if TYPE_CHECKING:
    from piezoharvest.diagnose import Diagnosis


def save_laws(found: Diagnosis, path: Path) -> None:
    """Write the laws without a name as effect files: the first as asked, a second beside it; each with its test."""
    from piezoharvest.diagnose.discovery.effect_file import save_effect
    from piezoharvest.diagnose.discovery.effect_test import save_effect_test

    if not found.discovery:
        note(f"warning: {path} is not written: no law without a name was found")
    beside = [each.effect for each in found.effects if each.effect.of_specimen]
    for n, law in enumerate(found.discovery, 1):
        target = path if n == 1 else path.with_stem(f"{path.stem}_{n}")
        save_effect(law, found.campaign.path.name, target, beside)
        note(f"effect: {target}, its test: {save_effect_test(target)}")
    if found.discovery and beside:
        note(f"the law was found beside {', '.join(each.name for each in beside)}: a study needs that, too")
