"""Design variables, objectives, constraints and optimizers; installed as `beltjax.optimize`."""

from beltjax.drive.variables import unit_of as unit_of
from beltjax.drive.variables import value_of as value_of
from beltjax.drive.variables import variable_names as variable_names
from beltjax.drive.variables import with_values as with_values

from . import lagrangian as lagrangian
from .choices import Chosen as Chosen
from .choices import enumerated as enumerated
from .design import minimize as minimize
from .designs import Grid as Grid
from .designs import Samples as Samples
from .exploration import explore as explore
from .files import load_study as load_study
from .optimality import Optimality as Optimality
from .outcome import ConstraintReport as ConstraintReport
from .outcome import Design as Design
from .outcome import Optimum as Optimum
from .outcome import StartReport as StartReport
from .pareto import Front as Front
from .pareto import FrontPoint as FrontPoint
from .pareto import pareto as pareto
from .postoptimal import PostOptimal as PostOptimal
from .postoptimal import fixed_numbers as fixed_numbers
from .postoptimal import number_value as number_value
from .postoptimal import post_optimal as post_optimal
from .quantities import Answers as Answers
from .quantities import quantity as quantity
from .search import History as History
from .store import open_exploration as open_exploration
from .study import Cases as Cases
from .study import Choice as Choice
from .study import Limits as Limits
from .study import Option as Option
from .study import Study as Study
