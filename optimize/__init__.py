"""Design variables, objectives, constraints and optimizers; installed as `beltjax.optimize`."""

from beltjax.drive.variables import unit_of as unit_of
from beltjax.drive.variables import value_of as value_of
from beltjax.drive.variables import variable_names as variable_names
from beltjax.drive.variables import with_values as with_values

from . import lagrangian as lagrangian
from .design import ConstraintReport as ConstraintReport
from .design import Design as Design
from .design import StartReport as StartReport
from .design import minimize as minimize
from .quantities import Answers as Answers
from .quantities import quantity as quantity
from .study import Limits as Limits
from .study import Study as Study
from .study import load_study as load_study
