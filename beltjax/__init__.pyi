"""The public API: what `import beltjax as bj` offers. Each name is loaded on first use."""

from .analysis.collocation import Collocation as Collocation
from .analysis.contact import ContactState as ContactState
from .analysis.contact import contact_state as contact_state
from .analysis.contact import maximum_moment as maximum_moment
from .analysis.contact_path import BeltPiece as BeltPiece
from .analysis.contact_path import belt_pieces as belt_pieces
from .analysis.contact_path import span_deflection as span_deflection
from .analysis.damping import Damping as Damping
from .analysis.driver_motion import CrankSignal as CrankSignal
from .analysis.duties import duty_states as duty_states
from .analysis.entry_angles import entry_angles as entry_angles
from .analysis.floquet import Floquet as Floquet
from .analysis.floquet import floquet as floquet
from .analysis.friction import lock_torque as lock_torque
from .analysis.friction_laws import AbstractFrictionLaw as AbstractFrictionLaw
from .analysis.friction_laws import CoulombFriction as CoulombFriction
from .analysis.friction_laws import CubicFriction as CubicFriction
from .analysis.friction_laws import StribeckFriction as StribeckFriction
from .analysis.friction_oscillator import FrictionCycle as FrictionCycle
from .analysis.friction_oscillator import FrictionOscillator as FrictionOscillator
from .analysis.friction_oscillator import friction_oscillator as friction_oscillator
from .analysis.linearization import Linearization as Linearization
from .analysis.linearization import linearize as linearize
from .analysis.modes import Modes as Modes
from .analysis.modes import modes as modes
from .analysis.moving_beam import MovingBeamModes as MovingBeamModes
from .analysis.moving_beam import SpanFrequencies as SpanFrequencies
from .analysis.moving_beam import moving_beam_modes as moving_beam_modes
from .analysis.moving_beam import span_frequencies as span_frequencies
from .analysis.orbit_measures import Measures as Measures
from .analysis.orders import Orders as Orders
from .analysis.parametric import Pairs as Pairs
from .analysis.parametric import parametric_pairs as parametric_pairs
from .analysis.parametric_margin import Margin as Margin
from .analysis.parametric_margin import Tongues as Tongues
from .analysis.parametric_margin import parametric_margin as parametric_margin
from .analysis.periodic import HarmonicBalance as HarmonicBalance
from .analysis.periodic import PeriodicResponse as PeriodicResponse
from .analysis.periodic import Shooting as Shooting
from .analysis.periodic import periodic_response as periodic_response
from .analysis.periodic import stability_margin as stability_margin
from .analysis.periodic_branch import PeriodicBranch as PeriodicBranch
from .analysis.periodic_branch import periodic_branch as periodic_branch
from .analysis.reference import ReferenceState as ReferenceState
from .analysis.reference import reference_state as reference_state
from .analysis.response import Excitation as Excitation
from .analysis.response import Response as Response
from .analysis.response import frequency_response as frequency_response
from .analysis.response import peak_response as peak_response
from .analysis.response import speed_response as speed_response
from .analysis.slip_margin import SlipMargin as SlipMargin
from .analysis.slip_margin import slip_margin as slip_margin
from .analysis.slip_onset import SlipOnset as SlipOnset
from .analysis.slip_onset import slip_onset as slip_onset
from .analysis.slip_stability import SlipStability as SlipStability
from .analysis.slip_stability import slip_stability as slip_stability
from .analysis.span_stability import SpanStability as SpanStability
from .analysis.span_stability import span_stability as span_stability
from .analysis.steady import Exact as Exact
from .analysis.steady import Linear as Linear
from .analysis.steady import Perturbation as Perturbation
from .analysis.steady import SteadyState as SteadyState
from .analysis.steady import steady_state as steady_state
from .analysis.sweep import Sweep as Sweep
from .analysis.sweep import sweep as sweep
from .analysis.tracking import Veering as Veering
from .analysis.transient import PeakSpeeds as PeakSpeeds
from .analysis.transient import Transient as Transient
from .analysis.transient import transient as transient
from .compiling.cache import use_cache as use_cache
from .compiling.quick import quick_jit as quick_jit
from .compiling.quick import thorough_jit as thorough_jit
from .drive.components import ArmSpring as ArmSpring
from .drive.components import Belt as Belt
from .drive.components import Damper as Damper
from .drive.components import Isolator as Isolator
from .drive.components import Model as Model
from .drive.components import Pulley as Pulley
from .drive.components import Tensioner as Tensioner
from .drive.files import load_drive as load_drive
from .drive.files import load_duties as load_duties
from .drive.files import save_drive as save_drive
from .drive.installation import AdjustedToMark as AdjustedToMark
from .drive.installation import AdjustedToTension as AdjustedToTension
from .drive.installation import BeltGiven as BeltGiven
from .drive.installation import Preloaded as Preloaded
from .drive.installation import TensionGiven as TensionGiven
from .drive.layout import Layout as Layout
from .drive.layout import alignment_angles as alignment_angles
from .drive.layout import layout as layout
from .drive.loads import Load as Load
from .drive.operation import ExcitationGiven as ExcitationGiven
from .drive.operation import OperatingPoint as OperatingPoint
from .drive.system import Drive as Drive
from .files.errors import FileError as FileError
from .numerics.bases import Legendre as Legendre
from .numerics.bases import Sine as Sine
from .numerics.bvp.continuation import Branch as Branch
from .numerics.bvp.continuation import continue_bvp as continue_bvp
from .numerics.bvp.continuation import follow_branch as follow_branch
from .numerics.bvp.solve import BVPSolution as BVPSolution
from .numerics.bvp.solve import solve_bvp as solve_bvp
from .physics.belt_law import AbstractBeltLaw as AbstractBeltLaw
from .physics.belt_law import belt_law as belt_law
from .results import RESULTS as RESULTS
from .results import AnalysisError as AnalysisError

# An installation holds the package `optimize` inside this one, a checkout beside it.
# pyproject.toml tells pyright that it reads a checkout.
CHECKOUT: bool
if CHECKOUT:
    import optimize as optimize  # noqa: TID251
else:
    from . import optimize as optimize

__version__: str
