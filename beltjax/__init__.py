"""Differentiable solver for the design of serpentine belt drives."""

import importlib
from typing import Any

from beltjax.analysis.collocation import Collocation as Collocation
from beltjax.analysis.contact import ContactState as ContactState
from beltjax.analysis.contact import contact_state as contact_state
from beltjax.analysis.contact import maximum_moment as maximum_moment
from beltjax.analysis.contact_path import BeltPiece as BeltPiece
from beltjax.analysis.contact_path import belt_pieces as belt_pieces
from beltjax.analysis.contact_path import span_deflection as span_deflection
from beltjax.analysis.damping import Damping as Damping
from beltjax.analysis.linearization import Linearization as Linearization
from beltjax.analysis.linearization import linearize as linearize
from beltjax.analysis.modes import Modes as Modes
from beltjax.analysis.modes import modes as modes
from beltjax.analysis.moving_beam import MovingBeamModes as MovingBeamModes
from beltjax.analysis.moving_beam import SpanFrequencies as SpanFrequencies
from beltjax.analysis.moving_beam import moving_beam_modes as moving_beam_modes
from beltjax.analysis.moving_beam import span_frequencies as span_frequencies
from beltjax.analysis.reference import ReferenceState as ReferenceState
from beltjax.analysis.reference import reference_state as reference_state
from beltjax.analysis.response import Excitation as Excitation
from beltjax.analysis.response import Response as Response
from beltjax.analysis.response import frequency_response as frequency_response
from beltjax.analysis.response import peak_response as peak_response
from beltjax.analysis.response import speed_response as speed_response
from beltjax.analysis.steady import Exact as Exact
from beltjax.analysis.steady import Linear as Linear
from beltjax.analysis.steady import Perturbation as Perturbation
from beltjax.analysis.steady import SteadyState as SteadyState
from beltjax.analysis.steady import steady_state as steady_state
from beltjax.analysis.sweep import Sweep as Sweep
from beltjax.analysis.sweep import sweep as sweep
from beltjax.analysis.tracking import Veering as Veering
from beltjax.drive.components import Belt as Belt
from beltjax.drive.components import BeltGiven as BeltGiven
from beltjax.drive.components import Drive as Drive
from beltjax.drive.components import ExcitationGiven as ExcitationGiven
from beltjax.drive.components import OperatingPoint as OperatingPoint
from beltjax.drive.components import Pulley as Pulley
from beltjax.drive.components import Tensioner as Tensioner
from beltjax.drive.components import TensionGiven as TensionGiven
from beltjax.drive.files import load_drive as load_drive
from beltjax.drive.files import save_drive as save_drive
from beltjax.drive.layout import Layout as Layout
from beltjax.drive.layout import layout as layout
from beltjax.errors import FileError as FileError
from beltjax.numerics.bases import Legendre as Legendre
from beltjax.numerics.bases import Sine as Sine
from beltjax.numerics.bvp import BVPSolution as BVPSolution
from beltjax.numerics.bvp import solve_bvp as solve_bvp
from beltjax.numerics.bvp_continuation import Branch as Branch
from beltjax.numerics.bvp_continuation import continue_bvp as continue_bvp
from beltjax.numerics.bvp_continuation import follow_branch as follow_branch
from beltjax.results import RESULTS as RESULTS
from beltjax.results import AnalysisError as AnalysisError


def __getattr__(name: str) -> Any:
    # Loaded on first use: `beltjax.optimize` stands on `beltjax`, not the other way round.
    if name == "optimize":
        return importlib.import_module("beltjax.optimize")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
