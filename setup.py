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
KERNELS = [f"{FOLDER}/kernels.c", f"{FOLDER}/target.h", f"{PARTS}/real.h", f"{PARTS}/driver.h"]
BINDING = ["sst_pin/compiled/_binding.pyx", "sst_pin/compiled/batches.h"]
FAST = ["-std=gnu11", "-O3", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast"]
#: For x86 without AVX2, which is rare: half of the time to compile, a tenth more to run.
RARE = ["-O1", "-fexpensive-optimizations"] if platform.machine() == "x86_64" else []


class BuildWithUrdf(build_py):
    """Puts urdf/ inside the package; an editable installation finds it where it is.

    Nothing stays of an earlier build but extensions, which `BuildOnAllCores` judges.
    """

    def run(self) -> None:
        package = Path(self.build_lib, "sst_pin")
        for left in package.rglob("*") if not self.editable_mode else ():
            if left.is_file() and left.suffix != ".so":
                left.unlink()
        super().run()
        if not self.editable_mode:
            shutil.copytree("urdf", package / "urdf", dirs_exist_ok=True)


class BuildOnAllCores(build_ext):
    """Compiles extensions side by side; keeps those whose sources have not changed.

    Each contains the hash of its sources. Dates tell nothing: an archive keeps those of its files.
    """

    def initialize_options(self) -> None:
        super().initialize_options()
        self.parallel = True

    def finalize_options(self) -> None:
        super().finalize_options()
        self.anew, self.force = self.force, True

    def build_extension(self, extension: Extension) -> None:
        place = Path(self.get_ext_fullpath(extension.name))
        kept = [place, Path(self.get_ext_filename(extension.name))]
        (hashed,) = (value for name, value in extension.define_macros if name == "MADE_OF")
        made = [x for x in kept if x.is_file() and hashed.strip('"').encode() in x.read_bytes()]
        if self.anew or not made:
            place.unlink(missing_ok=True)  # what is left, if it cannot be compiled, is no old one
            super().build_extension(extension)
        elif place not in made:
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(made[0], place)


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
            BINDING[:1],
            depends=BINDING,
            include_dirs=[np.get_include()],
            define_macros=[
                ("NPY_NO_DEPRECATED_API", "NPY_1_22_API_VERSION"),
                made_of(*BINDING),
            ],
            extra_compile_args=["-O2", "-g0", "-pthread"],
            extra_link_args=["-pthread"],
            optional=True,
        ),
        *(
            Extension(
                f"sst_pin.sst.kernels._{target}",  # no module: ctypes loads it
                [f"{FOLDER}/{target}.c"],
                depends=KERNELS,
                include_dirs=[PARTS],
                define_macros=[made_of(*KERNELS, f"{FOLDER}/{target}.c")],
                extra_compile_args=[*FAST, *(RARE if "plain" in target else []), "-g0"],
                optional=True,  # without a compiler the reference path computes everything
            )
            for target in ("avx512", "avx2", "avx2_one", "plain", "plain_one")
        ),
    ],
)
