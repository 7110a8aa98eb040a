import os

# Compiling is most of what these tests wait for: do it as `quickly_compiled` does. Set before
# JAX starts.
QUICK = " --xla_cpu_use_fusion_emitters=false --xla_backend_optimization_level=0"
os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + QUICK

# A second thread of OpenBLAS only waits where both cores are at work.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax  # noqa: E402

jax.config.update("jax_enable_x64", True)
