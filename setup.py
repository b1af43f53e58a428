# SPDX-License-Identifier: BSD-2-Clause
"""The extension module, the folder urdf, the README for indexes; all else is in pyproject.toml."""

import hashlib
import re
import shutil
from pathlib import Path

import numpy as np
from setuptools import Extension, setup
from setuptools.command.build_py import build_py

BINDING = ["sst_pin/compiled/_binding.pyx", "sst_pin/compiled/batches.h"]


class BuildWithUrdf(build_py):
    """Puts urdf/ inside the package; an editable installation finds it where it is."""

    def run(self) -> None:
        package = Path(self.build_lib, "sst_pin")
        if not self.editable_mode:
            shutil.rmtree(package, ignore_errors=True)  # files of an earlier build
        super().run()
        if not self.editable_mode:
            shutil.copytree("urdf", package / "urdf")


def readme() -> str:
    """README.md where no file lies beside it: without pictures, paths in the place of links."""
    text = Path("README.md").read_text(encoding="utf-8")
    text = re.sub(r"!\[[^\]]*\]\((?!https?:)[^)]*\)", "", text)
    return re.sub(r"\[([^\]]+)\]\((?!https?:)([^)]+)\)", r"\1 (`\2`)", text)


#: The hash by which `sst_pin/compiled/extension.py` refuses an extension of other sources.
sources = hashlib.sha256(b"".join(Path(source).read_bytes() for source in BINDING)).hexdigest()
setup(
    long_description=readme(),
    long_description_content_type="text/markdown",
    cmdclass={"build_py": BuildWithUrdf},
    options={"build_ext": {"force": True}},  # an archive keeps the dates of its files
    ext_modules=[
        Extension(
            "sst_pin.compiled._binding",
            BINDING[:1],
            depends=BINDING,
            include_dirs=[np.get_include()],
            define_macros=[
                ("NPY_NO_DEPRECATED_API", "NPY_1_22_API_VERSION"),
                ("SOURCES", f'"{sources}"'),
            ],
            extra_compile_args=["-O2", "-g0", "-pthread"],
            extra_link_args=["-pthread"],
            optional=True,  # without a compiler the reference path computes everything
        )
    ],
)
