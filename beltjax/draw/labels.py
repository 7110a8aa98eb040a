"""Labels of modes that name the spans of a drive."""

from beltjax.analysis.modes import Modes
from beltjax.drive.system import Drive


def mode_labels(drive: Drive, modes: Modes) -> tuple[str, ...]:
    """The modes' labels with the spans' names in them."""
    return tuple(span_label(drive, label) for label in modes.labels)


def span_label(drive: Drive, label: str) -> str:
    """A mode's label with the span's name in place of its number."""
    names = {f"span {i}": f"span {name}" for i, name in enumerate(drive.span_names)}
    return names.get(label, label)
