"""Files as the page opens them: a drive or a study becomes a study that can be judged."""

import os
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from beltjax import optimize
from beltjax.drive.duties import stacked
from beltjax.drive.files import load_runs
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.files.reading import read_toml
from beltjax.studio.handles import handles

_WIDE = 0.05  # of the stand-in bounds of a drive that no study is of [m]


class Opened(NamedTuple):
    """What was opened."""

    study: optimize.Study  # with what every drive must meet added to its constraints
    is_study: bool  # false: a drive file, of which nothing but that is asked
    own_constraints: int  # the first of the study's, which its file gives
    texts: dict[str, str]  # the files, by name; the first is the one that names the others
    kept: dict[str, Any] | None = None  # what the file of a page says was done


def open_file(path: str | os.PathLike[str]) -> Opened:
    """The drive file or study file at `path`; raises `FileError` for what is wrong with it."""
    content = read_toml(path)
    named = content.get("drive") if "belt" not in content else None
    texts = {Path(path).name: Path(path).read_text("utf-8-sig")}
    if isinstance(named, str):
        study = optimize.load_study(path)
        texts[named] = (Path(path).parent / named).read_text("utf-8-sig")
        own = len(study.constraints.names)
        return Opened(optimize.with_implied_constraints(study), True, own, texts)
    drive, runs = load_runs(path)
    cases = None
    if runs.duties:
        try:
            cases = optimize.Cases(stacked(runs.duties), tuple(runs.duties), are_duties=True)
        except ValueError as error:
            raise FileError(path, "duty", str(error)) from error
    point = jax.tree.map(lambda x: x[0], cases.points) if cases else runs.point
    study = optimize.Study(
        drive=drive,
        point=point,
        variables=_own_variables(drive),
        constraints=optimize.Limits((), jnp.zeros(0), jnp.zeros(0)),
        weights=jnp.ones(1),
        name=Path(path).stem,
        cases=cases,
    )
    return Opened(optimize.with_implied_constraints(study), False, 0, texts)


def _own_variables(drive: Drive) -> optimize.Limits:
    """The radius of the first pulley: a study has a variable, also where nothing is chosen."""
    first = next(one for one in handles(drive) if one.kind == "rim")
    radius = float(drive.pulleys[first.place].radius)
    return optimize.Limits(first.names[0], jnp.array([radius - _WIDE]), jnp.array([radius + _WIDE]))
