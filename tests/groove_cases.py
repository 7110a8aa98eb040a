"""Drives whose belt wedges in grooves, and what an independent solver found for them."""

import json
from pathlib import Path

import numpy as np

import beltjax as bj

STORED = json.loads((Path(__file__).parent / "data" / "grooves.json").read_text())
CASES, ZONES, STRING = (STORED[key] for key in ("cases", "zones", "string"))
MASS = 0.1  # [kg/m]: any, since cases give the momentum flux


def grooved_drive(name, by="length", moment=None):
    """The drive of a stored case and its operating point."""
    case = CASES[name]
    wedges = [pulley["groove"] for pulley in case["pulleys"] if pulley["groove"]]
    belt = bj.Belt(
        axial_stiffness=case["EA"],
        bending_stiffness=0.0,
        mass_per_length=MASS,
        wedge_angle=np.radians(wedges[0]["angle_deg"]),
        wedge_stiffness=wedges[0]["K"],
    )
    pulleys = [
        bj.Pulley(
            name=f"p{place}",
            center=pulley["c"],
            radius=pulley["R"],
            face=float(pulley["t"]),
            friction=pulley["mu"],
            driver=float(place == 0),
        )
        for place, pulley in enumerate(case["pulleys"])
    ]
    rules = {
        "length": bj.BeltGiven(belt_length=case["L0"]),
        "tension": bj.TensionGiven(tension=case["idle_tension"]),
    }
    torque = {f"p{i}": pulley["M"] for i, pulley in enumerate(case["pulleys"]) if i}
    if moment is not None:
        torque["p1"] = moment
    point = bj.OperatingPoint(belt_speed=np.sqrt(case["m0c2"] / MASS), torque=torque)
    return bj.Drive(belt=belt, pulleys=pulleys, installation=rules[by]), point
