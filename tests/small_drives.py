"""Texts of small drive files, from a line for each pulley."""

BELT = """
[belt]
axial_stiffness = {EA}
bending_stiffness = 0.0
mass_per_length = {mass}
"""
PULLEY = """[[pulley]]
name = "{name}"
center = [{x}, {y}]
radius = {radius}
face = "{face}"
"""


def belt(EA="1e5", mass=0.1):
    """The table of a belt that does not resist bending."""
    return BELT.format(EA=EA, mass=mass)


def pulley(name, x, y, radius, face="grooved", more=""):
    """The table of a pulley, with `more` lines."""
    return PULLEY.format(name=name, x=x, y=y, radius=radius, face=face) + (more and f"{more}\n")


# A crankshaft and a pump at one height, and an idler that presses the upper strand down.
PRESSED = (
    belt()
    + pulley("crank", 0.0, 0.0, 0.08, more="driver = true")
    + pulley("pump", 0.4, 0.0, 0.08)
    + pulley("idler", 0.2, 0.05, 0.03, "back")
)
