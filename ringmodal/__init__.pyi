from ema import (
    FRF as FRF,
)
from ema import (
    Campaign as Campaign,
)
from ema import (
    FitError as FitError,
)
from ema import (
    Identification as Identification,
)
from ema import (
    InputError as InputError,
)
from ema import (
    ModalModel as ModalModel,
)
from ema import (
    Mode as Mode,
)
from ema import (
    Processing as Processing,
)
from ema import (
    SensorMass as SensorMass,
)
from ema import (
    StabilityDiagram as StabilityDiagram,
)
from ema import (
    build_stability as build_stability,
)
from ema import (
    estimate_frf as estimate_frf,
)
from ema import (
    fit_modes as fit_modes,
)
from ema import (
    identify_modes as identify_modes,
)
from ema import (
    read_campaign as read_campaign,
)
from ema import (
    read_shapes as read_shapes,
)
from ema import (
    select_poles as select_poles,
)
from ema.core.mac import (
    auto_mac as auto_mac,
)
from ema.core.mac import (
    frac as frac,
)
from ema.core.mac import (
    mac as mac,
)
from ema.core.mac import (
    mpc as mpc,
)
from ema.core.mac import (
    mpd_deg as mpd_deg,
)
from ema.core.settings import (
    CheckSettings as CheckSettings,
)
from ema.core.settings import (
    IdentificationSettings as IdentificationSettings,
)
from model import (
    ParameterError as ParameterError,
)
from model import (
    RingDamping as RingDamping,
)
from model import (
    RingParameters as RingParameters,
)
from model import (
    TuningResult as TuningResult,
)
from model import (
    identify_damping as identify_damping,
)
from model import (
    inertance as inertance,
)
from model import (
    natural_frequencies_hz as natural_frequencies_hz,
)
from model import (
    tune_ring as tune_ring,
)
from pipelines.compare.compare import (
    Comparison as Comparison,
)
from pipelines.compare.compare import (
    compare as compare,
)
from pipelines.compare.compare import (
    compare_folders as compare_folders,
)
from pipelines.process import process as process
from pipelines.process import retune as retune
from pipelines.report.save import save as save
from pipelines.report.write import write_report as write_report
from pipelines.results.options import Options as Options
from pipelines.results.result import Result as Result
from pipelines.results.store import load as load
from pipelines.simulate.campaign import simulate_campaign as simulate_campaign

__version__: str
