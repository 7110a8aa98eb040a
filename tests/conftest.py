import gc
import json
import os
import sys
from importlib.metadata import version
from pathlib import Path

# Compiling is most of what these tests wait for: do it as `quickly_compiled` does. Set before
# JAX starts.
QUICK = " --xla_backend_optimization_level=0"
if version("jaxlib").startswith("0.10."):  # an option that XLA does not know ends the process
    QUICK += " --xla_cpu_use_fusion_emitters=false"
os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + QUICK

# A second thread of OpenBLAS only waits where both cores are at work.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax  # noqa: E402
import pytest  # noqa: E402
from schemas import documented  # noqa: E402

import beltjax as bj  # noqa: E402
import beltjax.__main__  # noqa: E402
import beltjax.commands.registry  # noqa: E402
import beltjax.commands.running  # noqa: E402
import beltjax.compiling.kept_programs  # noqa: E402
import beltjax.physics.belt_law  # noqa: E402

jax.config.update("jax_enable_x64", True)


# These run the three-pulley study.
STUDIES = (
    "test_cli.py",
    "test_studies_of_examples.py",
    "test_minimization.py",
    "test_readme.py",
)

# These find contact, as do the files that have it in their names.
CONTACT = ("test_belt_law.py", "test_closed_belt.py")
# These vibrate the drives of the examples.
VIBRATION = ("test_modes.py", "test_sweep.py", "test_validity.py", "test_response.py")


# Linux ends a process with more than 65,530 memory maps, of which a compiled program takes a few to
# a thousand.
MANY_MAPS = 35_000


@pytest.fixture(autouse=True, scope="module")
def room_for_programs():
    """Programs are forgotten after a file where there are many."""
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > MANY_MAPS:
        jax.clear_caches()
        gc.collect()


@pytest.fixture
def own_registries(monkeypatch):
    """What a test registers is forgotten after it."""
    quantities, optimizers = bj.optimize.quantities, bj.optimize.search.registry
    monkeypatch.setattr(quantities, "_DEFINITIONS", dict(quantities._DEFINITIONS))
    monkeypatch.setattr(optimizers, "_OPTIMIZERS", dict(optimizers._OPTIMIZERS))
    laws = beltjax.physics.belt_law
    monkeypatch.setattr(laws, "_LAWS", dict(laws._LAWS))
    commands = beltjax.commands.registry
    monkeypatch.setattr(commands, "_REGISTERED", dict(commands.registered()))
    monkeypatch.setattr(commands.group, "commands", dict(commands.group.commands))
    monkeypatch.setattr(beltjax.compiling.kept_programs, "_keeping", [True])


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Run the command line in this process, in an empty folder: status, output, errors."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(beltjax.commands.running, "prepare_jax", lambda: None)

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["beltjax", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            beltjax.__main__.main()
        output = capsys.readouterr()
        _check_document([*map(str, words)], end.value.code, output.out)
        return end.value.code, output.out, output.err

    return call


def _check_document(words, status, output):
    """Where a command has written a document, hold it to its schema."""
    if "--json" not in words or status not in (0, 2):
        return
    place = words[words.index("--json") + 1]
    text = output if place == "-" else Path(place).read_text() if Path(place).is_file() else ""
    if text.startswith("{"):
        documented(words[0], json.loads(text))


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(items):
    """A worker takes whole files, and all of a group: they share what compiles."""
    for item in items:
        name = item.path.name
        group = "studies" if name in STUDIES else str(item.path)
        group = "contact" if "contact" in name or name in CONTACT else group
        group = "vibration" if name in VIBRATION else group
        item.add_marker(pytest.mark.xdist_group(group))
