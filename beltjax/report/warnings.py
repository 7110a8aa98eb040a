"""What limits the trust in a result, in words: for the JSON, the tables and the command line."""

from typing import Any

import numpy as np
from rich.text import Text

from beltjax.analysis.response import Response
from beltjax.analysis.steady import STIFFEST, SteadyState
from beltjax.drive.components import Drive
from beltjax.results import succeeded, successes

Warnings = list[dict[str, str]]


def steady_warnings(drive: Drive, steady: SteadyState) -> Warnings:
    """Where a steady state leaves the limits of its model; empty where it does not."""
    if not succeeded(steady.result) or succeeded(steady.warning):
        return []
    ratios = np.asarray(steady.stiffness_ratios)
    stiff = [
        f"{name} ({ratio:.2g})"
        for name, ratio in zip(drive.pulley_names, ratios, strict=True)
        if ratio > STIFFEST
    ]
    return [
        {
            "code": "belt_stiff_on_pulley",
            "text": f"the belt is stiff for {', '.join(stiff)}: sqrt(EI/T)/radius is above "
            f"{STIFFEST:g}, so that tensions, wraps and Gamma with the contact points of a string "
            "are off; `beltjax contact` finds where the belt really touches",
        }
    ]


def modes_left_out(drive: Drive, most: int) -> dict[str, str]:
    """That a drive has more pulleys than modes are found for."""
    text = (
        f"modes are left out: they are found for {most} pulleys at most, and there are "
        f"{len(drive.pulleys)}"
    )
    return {"code": "modes_left_out", "text": text}


def response_warnings(drive: Drive, found: Response) -> Warnings:
    """Which spans would go slack under the excitation, and from which part of it on."""
    good = successes(found.result)
    if not good.any():
        return []
    least = np.min(np.asarray(found.slack_factors)[good], axis=0)
    slack = [
        f"{name} from {factor:.3g} of this excitation on"
        for name, factor in zip(drive.span_names, least, strict=True)
        if factor < 1
    ]
    if not slack:
        return []
    text = (
        "the fluctuation of a tension exceeds the running tension, where a span goes slack and "
        f"linear amplitudes do not hold: {', '.join(slack)}"
    )
    return [{"code": "span_slackens", "text": text}]


def warning_lines(document: dict[str, Any]) -> list[Text]:
    """The warnings of a document as they stand above its tables."""
    return [Text(f"warning: {one['text']}\n", style="yellow") for one in document["warnings"]]
