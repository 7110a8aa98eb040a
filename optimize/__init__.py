"""Design variables, objectives, constraints and optimizers; installed as `beltjax.optimize`."""

from . import lagrangian as lagrangian
from .design import ConstraintReport as ConstraintReport
from .design import Design as Design
from .design import StartReport as StartReport
from .design import minimize as minimize
from .quantities import quantity as quantity
from .study import Limits as Limits
from .study import Study as Study
from .study import load_study as load_study
from .variables import unit_of as unit_of
from .variables import value_of as value_of
from .variables import variable_names as variable_names
from .variables import with_values as with_values
