import os
import sys

# Compiling is most of what these tests wait for: do it as `quickly_compiled` does. Set before
# JAX starts.
QUICK = " --xla_cpu_use_fusion_emitters=false --xla_backend_optimization_level=0"
os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + QUICK

# A second thread of OpenBLAS only waits where both cores are at work.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax  # noqa: E402
import pytest  # noqa: E402

import beltjax.cli  # noqa: E402

jax.config.update("jax_enable_x64", True)


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Run the command line in this process, in an empty folder: status, output, errors."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(beltjax.cli, "_prepare_jax", lambda: None)

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["beltjax", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            beltjax.cli.main()
        output = capsys.readouterr()
        return end.value.code, output.out, output.err

    return call


def pytest_collection_modifyitems(items):
    """A worker takes whole files, and all of contact: those share what takes longest to compile."""
    for item in items:
        name = item.path.name
        group = "contact" if "contact" in name else str(item.path)
        item.add_marker(pytest.mark.xdist_group(group))
