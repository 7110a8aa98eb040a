"""The registry of optimizers, whose names `method` in a study gives.

An optimizer is a class under `optimizer`, made without arguments. Most override `minimize` of
`AbstractLocalOptimizer`, which takes one start after the other; one that takes all starts at once
overrides `search` of `AbstractOptimizer`.
"""

import abc
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from ..problem import Starts
    from ..study import Study
    from .results import SearchResult, SearchTools

DEFAULT = "sqp"


class AbstractOptimizer(abc.ABC):
    """An optimizer of studies."""

    @abc.abstractmethod
    def search(self, study: "Study", begin: "Starts", tools: "SearchTools") -> "SearchResult":
        """Search from every start.

        Args:
            study: the study.
            begin: its starts in the unit box, with the problem's scales.
            tools: the problem's values and derivatives at a design, a function to report progress,
                the deadline and the checkpoint.

        Returns:
            One outcome for each start, in their order.
        """


Optimizer = TypeVar("Optimizer", bound=AbstractOptimizer)

_OPTIMIZERS: dict[str, AbstractOptimizer] = {}


def optimizer(name: str) -> Callable[[type[Optimizer]], type[Optimizer]]:
    """Register a class of optimizers under the name that `method` in a study gives.

    Args:
        name: the name.

    Returns:
        A decorator that registers the class, makes one optimizer of it without arguments, and
        returns the class unchanged.

    Raises:
        ValueError: the name is empty or taken.
    """
    if not name or name in _OPTIMIZERS:
        raise ValueError(f"optimizer: found the name {name!r}; give one that is not taken.")

    def register(kind: type[Optimizer]) -> type[Optimizer]:
        _OPTIMIZERS[name] = kind()
        return kind

    return register


def optimizer_names() -> tuple[str, ...]:
    """The names of all registered optimizers.

    Returns:
        The names, with the default optimizer first.
    """
    return tuple(sorted(_OPTIMIZERS, key=lambda name: name != DEFAULT))


def find_optimizer(name: str) -> AbstractOptimizer:
    """The optimizer of that name.

    Args:
        name: the name that `method` in a study gives.

    Returns:
        The registered optimizer.

    Raises:
        KeyError: there is no optimizer of that name; the text lists those there are.
    """
    if name not in _OPTIMIZERS:
        known = ", ".join(map(repr, optimizer_names()))
        raise KeyError(f"method {name!r} is not one of {known}")
    return _OPTIMIZERS[name]
