# SPDX-License-Identifier: BSD-2-Clause
"""Extension modules, the folder urdf, the README for indexes; all else is in pyproject.toml."""

import hashlib
import platform
import re
import shutil
from pathlib import Path

import numpy as np
from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py

FOLDER = "sst_pin/sst/kernels"
PARTS = "sst_pin/compiled/c"
KERNELS = [f"{FOLDER}/kernels.c", f"{PARTS}/real.h", f"{PARTS}/driver.h"]
FAST = ["-std=gnu11", "-O3", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast"]
#: For x86 without AVX2, which is rare: half of the time to compile, a tenth more to run.
RARE = ["-O1", "-fexpensive-optimizations"] if platform.machine() == "x86_64" else []


class BuildWithUrdf(build_py):
    """Puts urdf/ inside the package; an editable installation finds it where it is."""

    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            shutil.copytree("urdf", Path(self.build_lib, "sst_pin", "urdf"), dirs_exist_ok=True)


class BuildOnAllCores(build_ext):
    """Compiles extensions side by side; keeps those in place whose sources have not changed."""

    def initialize_options(self) -> None:
        super().initialize_options()
        self.parallel = True

    def build_extension(self, extension: Extension) -> None:
        kept = Path(self.get_ext_filename(extension.name))
        place = Path(self.get_ext_fullpath(extension.name))
        (hashed,) = (value for name, value in extension.define_macros if name == "MADE_OF")
        if self.force or not kept.is_file() or hashed.strip('"').encode() not in kept.read_bytes():
            super().build_extension(extension)
        elif kept.resolve() != place.resolve():
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(kept, place)


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
    cmdclass={"build_py": BuildWithUrdf, "build_ext": BuildOnAllCores},
    ext_modules=[
        Extension(
            "sst_pin.compiled._binding",
            ["sst_pin/compiled/_binding.pyx"],
            depends=["sst_pin/compiled/batches.h"],
            include_dirs=[np.get_include()],
            define_macros=[
                ("NPY_NO_DEPRECATED_API", "NPY_1_22_API_VERSION"),
                made_of("sst_pin/compiled/_binding.pyx", "sst_pin/compiled/batches.h"),
            ],
            extra_compile_args=["-O2", "-g0", "-pthread"],
            extra_link_args=["-pthread"],
            optional=True,
        ),
        *(
            Extension(
                f"sst_pin.sst.kernels._{target}",  # no module: ctypes loads it
                [f"{FOLDER}/{target}.c"],
                depends=[*KERNELS, f"{FOLDER}/target.h"],
                include_dirs=[PARTS],
                define_macros=[made_of(*KERNELS)],
                extra_compile_args=[*FAST, *(RARE if "plain" in target else []), "-g0"],
                optional=True,  # without a compiler the reference path computes everything
            )
            for target in ("avx512", "avx2", "avx2_one", "plain", "plain_one")
        ),
    ],
)
