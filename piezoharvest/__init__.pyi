"""Public names for type checkers; `__init__.py` loads each when it is first used."""

from typing import Final

from piezoharvest.bench import (
    measure as measure,
)
from piezoharvest.description.circuit import (
    Port as Port,
    Product as Product,
    State as State,
)
from piezoharvest.description.diode import (
    DiodeLine as DiodeLine,
    exponential_diode as exponential_diode,
    measured_diode as measured_diode,
)
from piezoharvest.description.effects import (
    BiasCurrent as BiasCurrent,
    ChannelSkew as ChannelSkew,
    Clipping as Clipping,
    ContactCompliance as ContactCompliance,
    CouplingDrift as CouplingDrift,
    Creep as Creep,
    DielectricRelaxation as DielectricRelaxation,
    DiodeDropError as DiodeDropError,
    DisplacementLag as DisplacementLag,
    Effect as Effect,
    Friction as Friction,
    InversionLoss as InversionLoss,
    Leakage as Leakage,
    LoadError as LoadError,
    MainsHum as MainsHum,
    MissedSwitching as MissedSwitching,
    NonlinearCoupling as NonlinearCoupling,
    OnTimeOffset as OnTimeOffset,
    ProbeLoading as ProbeLoading,
    ReverseLeakage as ReverseLeakage,
    Stiffening as Stiffening,
    SwitchDelay as SwitchDelay,
    VoltageDependentCapacitance as VoltageDependentCapacitance,
    VoltageReversion as VoltageReversion,
)
from piezoharvest.description.excitation import (
    Excitation as Excitation,
    Multisine as Multisine,
    RandomBase as RandomBase,
    RandomForce as RandomForce,
    Record as Record,
    SineBase as SineBase,
    SineForce as SineForce,
    StepForce as StepForce,
)
from piezoharvest.description.hysteresis import (
    Hysteresis as Hysteresis,
)
from piezoharvest.description.parameters import (
    Component as Component,
    ParameterError as ParameterError,
    quantity as quantity,
)
from piezoharvest.description.shunts import (
    Battery as Battery,
    BiasFlip as BiasFlip,
    CurrentBlocking as CurrentBlocking,
    CurrentFlowing as CurrentFlowing,
    DSSH as DSSH,
    Doubler as Doubler,
    HalfWave as HalfWave,
    LinearShunt as LinearShunt,
    NegativeCapacitance as NegativeCapacitance,
    Network as Network,
    Open as Open,
    ParallelBranches as ParallelBranches,
    ParallelRL as ParallelRL,
    ParallelRLC as ParallelRLC,
    ParallelSSHI as ParallelSSHI,
    Rectifier as Rectifier,
    Resistor as Resistor,
    SCSECE as SCSECE,
    SECE as SECE,
    SICE as SICE,
    SSDI as SSDI,
    SSDS as SSDS,
    SSDV as SSDV,
    SSHC as SSHC,
    SeriesRL as SeriesRL,
    SeriesRLC as SeriesRLC,
    SeriesSSHI as SeriesSSHI,
    Short as Short,
    Shunt as Shunt,
    SpiceCircuit as SpiceCircuit,
)
from piezoharvest.description.system import (
    System as System,
)
from piezoharvest.description.transducer import (
    Mode as Mode,
    Transducer as Transducer,
)
from piezoharvest.design import (
    DesignResult as DesignResult,
    design as design,
)
from piezoharvest.diagnose import (
    Diagnosis as Diagnosis,
    diagnose as diagnose,
)
from piezoharvest.engine import (
    Gradient as Gradient,
    NoGradientError as NoGradientError,
    Response as Response,
    Waveforms as Waveforms,
    gradient as gradient,
    simulate as simulate,
    simulate_many as simulate_many,
)
from piezoharvest.identify import (
    Identification as Identification,
    identify as identify,
)
from piezoharvest.linear import (
    TwoPort as TwoPort,
    admittance as admittance,
    closed_loop as closed_loop,
    coupling_factor as coupling_factor,
    frequency_response as frequency_response,
    linearize as linearize,
    resonances as resonances,
)
from piezoharvest.records import (
    Campaign as Campaign,
    CampaignError as CampaignError,
    load_campaign as load_campaign,
)
from piezoharvest.report import (
    write_diagnosis as write_diagnosis,
    write_identification as write_identification,
    write_report as write_report,
)
from piezoharvest.specimen import (
    Specimen as Specimen,
    load_specimen as load_specimen,
)
from piezoharvest.study import (
    DesignOptions as DesignOptions,
    Study as Study,
    StudyError as StudyError,
    load_study as load_study,
)
from piezoharvest.sweep import (
    sweep as sweep,
)

__version__: Final[str]
__all__: Final[list[str]]
