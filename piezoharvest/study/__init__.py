"""Studies: TOML files to objects, checked, with whatever is wrong said in one sentence."""

from piezoharvest.study.building import allowed_values, build, build_effect, build_excitation, build_shunt, unit_of
from piezoharvest.study.options import SYNTHESISED, DesignOptions, SweepOptions, SweepParameter
from piezoharvest.study.studies import Study, check_systems, load_driven_study, load_study, study_from
from piezoharvest.study.toml_file import MAX_TOML_BYTES, StudyError, check_kind_of_file, read_toml
from piezoharvest.study.transducers import build_transducer, from_catalogue, read_specimen, transducer_table
from piezoharvest.study.words import unknown

__all__ = [
    "MAX_TOML_BYTES",
    "SYNTHESISED",
    "DesignOptions",
    "Study",
    "StudyError",
    "SweepOptions",
    "SweepParameter",
    "allowed_values",
    "build",
    "build_effect",
    "build_excitation",
    "build_shunt",
    "build_transducer",
    "check_kind_of_file",
    "check_systems",
    "from_catalogue",
    "load_driven_study",
    "load_study",
    "read_specimen",
    "read_toml",
    "study_from",
    "transducer_table",
    "unit_of",
    "unknown",
]
