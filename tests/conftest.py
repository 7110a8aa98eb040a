import os

# Compiling is most of what these tests wait for, and LLVM's optimization most of the compiling.
# Set before JAX starts; it changes rounding at the most.
os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_backend_optimization_level=0"

import jax

jax.config.update("jax_enable_x64", True)
