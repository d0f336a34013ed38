"""Names under which specimens share effects and parameters, wherever these stand in a specimen's model."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from piezoharvest.description.effects import Effect
from piezoharvest.description.effects.nameless.law import Law
from piezoharvest.description.transducer import Transducer
from piezoharvest.diagnose.selection.effect_change import effect_key
from piezoharvest.predict.parameters import Parameter
from piezoharvest.predict.prediction import PredictionError
from piezoharvest.progress import Step
from piezoharvest.records.errors import CampaignError


def kind_of(effect: Effect) -> str:
    """Identity of an effect among specimens: its name, with its channel or label; of a law its place and form."""
    return effect.name if isinstance(effect, Law) else effect_key(effect)


def variable_name(parameter: Parameter, transducer: Transducer) -> str:
    """Name of a parameter: its own, that of an effect by the effect: "leakage.resistance"."""
    if parameter.title or parameter.path[0] != "effects":
        return parameter.name
    words = [str(part) for part in parameter.path[2:] if part not in ("form", "memory")]
    return ".".join([kind_of(transducer.effects[int(parameter.path[1])]), *words])


def named_progress(progress: Callable[[str], None], name: str) -> Callable[[str], None]:
    """Progress messages of one specimen, which begin with its name."""
    return lambda text: progress(Step(f"{name}: {text}") if isinstance(text, Step) else f"{name}: {text}")


@contextmanager
def errors_of(name: str) -> Iterator[None]:
    """Say of which specimen an error is."""
    try:
        yield
    except CampaignError as error:
        raise CampaignError(error.path, error.key, f"{name}: {error.message}", campaign=error.campaign) from None
    except PredictionError as error:
        raise PredictionError(f"{name}: {error}") from None
