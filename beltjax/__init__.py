"""Differentiable solver for the design of serpentine belt drives.

The public API stands in `__init__.pyi`, from which each name is loaded on first use: `import
beltjax` is quick, and `beltjax --version` does not wait for JAX.
"""

from pathlib import Path

import lazy_loader

from beltjax.compiling.threads import give_xla_threads

__version__ = "0.1.0"

# In a checkout the package `optimize` lies beside this one and is found there; an installation
# has it inside.
_BESIDE = Path(__file__).resolve().parents[1]
if (_BESIDE / "optimize" / "study_file.py").is_file() and (_BESIDE / "pyproject.toml").is_file():
    __path__.append(str(_BESIDE))

give_xla_threads()

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
