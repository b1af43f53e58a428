# SPDX-License-Identifier: BSD-2-Clause
"""Extension modules, the folder urdf, the README for indexes; all else is in pyproject.toml."""

import hashlib
import re
import shutil
from pathlib import Path

import numpy as np
from setuptools import Extension, setup
from setuptools.command.build_py import build_py

FOLDER = "sst_pin/sst/kernels"
PARTS = "sst_pin/compiled/c"
COMPILE = [
    "-std=gnu11",
    "-O3",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-ffp-contract=fast",
    "-g0",
]


class BuildWithUrdf(build_py):
    """Puts urdf/ inside the package; an editable installation finds it where it is."""

    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            shutil.copytree("urdf", Path(self.build_lib, "sst_pin", "urdf"), dirs_exist_ok=True)


def readme() -> str:
    """README.md where no file lies beside it: without pictures, paths in the place of links."""
    text = Path("README.md").read_text(encoding="utf-8")
    text = re.sub(r"!\[[^\]]*\]\((?!https?:)[^)]*\)\n\n", "", text)
    return re.sub(r"\[([^\]]+)\]\((?!https?:)([^)]+)\)", r"\1 (`\2`)", text)


def made_of(*sources: str) -> tuple[str, str]:
    """The macro by which an extension tells its sources; `extensions.py` reads it."""
    content = b"".join(Path(source).read_bytes() for source in sources)
    return "MADE_OF", f'"{hashlib.sha256(content).hexdigest()}"'


setup(
    long_description=readme(),
    long_description_content_type="text/markdown",
    cmdclass={"build_py": BuildWithUrdf},
    ext_modules=[
        Extension(
            "sst_pin.sst.kernels._library",  # no module: ctypes loads it
            [f"{FOLDER}/{x}.c" for x in ("plain", "plain_one", "avx2", "avx2_one", "avx512")],
            depends=[f"{FOLDER}/{x}" for x in ("kernels.c", "target.h")]
            + [f"{PARTS}/{x}" for x in ("real.h", "driver.h")],
            include_dirs=[PARTS],
            define_macros=[
                made_of(f"{FOLDER}/kernels.c", f"{PARTS}/real.h", f"{PARTS}/driver.h"),
            ],
            extra_compile_args=COMPILE,
            optional=True,  # without a compiler the reference path computes everything
        ),
        *(
            Extension(
                f"sst_pin.{name.replace('/', '.')}",  # runs without being compiled, too
                [f"sst_pin/{name}.py"],
                depends=[f"sst_pin/{name}.pxd"],
                define_macros=[made_of(f"sst_pin/{name}.py", f"sst_pin/{name}.pxd")],
                extra_compile_args=["-O3"],
                optional=True,
            )
            for name in ("chain/calls", "sst/calls")
        ),
        Extension(
            "sst_pin.compiled._binding",
            ["sst_pin/compiled/_binding.pyx"],
            depends=["sst_pin/compiled/batches.h"],
            include_dirs=[np.get_include()],
            define_macros=[
                ("NPY_NO_DEPRECATED_API", "NPY_1_22_API_VERSION"),
                made_of("sst_pin/compiled/_binding.pyx", "sst_pin/compiled/batches.h"),
            ],
            extra_compile_args=["-O2", "-pthread"],
            extra_link_args=["-pthread"],
            optional=True,
        ),
    ],
)
