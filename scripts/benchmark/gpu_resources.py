# SPDX-License-Identifier: BSD-2-Clause
"""What the kernels of a robot need on a GPU: operations, registers, stack, code; without a GPU."""

import struct
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import casadi as ca
import warp as wp

import sst_pin
from sst_pin.compiled import kernels, warp_batch
from sst_pin.dynamics.quantities import Quantity

#: The quantities that are measured, by the names in the tables.
KERNELS = {
    "torques": Quantity("torques"),
    "accelerations": Quantity("accelerations"),
    "steps": Quantity("rollout"),
}
#: Instructions of CasADi that are no arithmetic.
_FREE = {ca.OP_NEG, ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT}
#: Evaluations of the equations in one step, which closes the loops so often.
_EVALUATIONS_OF_A_STEP = 4

Row = dict[str, Any]


def operations(batch: warp_batch.WarpBatch, quantity: Quantity) -> int:
    """Arithmetic operations of one sample."""
    total = 0
    for kernel in kernels.entry(batch._equations_of(False, False), quantity):
        inputs = [ca.vertcat(*kernel.inputs.values()), kernel.parameters]
        result = ca.vertcat(kernel.output, kernel.checks)
        function = ca.Function("count", inputs, [ca.densify(result)], {"cse": True})
        codes = [function.instruction_id(i) for i in range(function.n_instructions())]
        total += len([code for code in codes if code not in _FREE])
    return total * _EVALUATIONS_OF_A_STEP if quantity.name == "rollout" else total


def resources(name: str, chain: sst_pin.ClosedChain, dtype: str, arch: int) -> list[Row]:
    """What the machine code of a robot's kernels needs, compiled for an architecture."""
    quantities = dict(KERNELS)
    if len(chain.motor_names) < chain.degrees_of_freedom:
        quantities["torques"] = Quantity("generalized_forces")
    batch = chain.warp("cpu", dtype)
    rows = []
    for label, quantity in quantities.items():
        module = batch.module(quantity)
        start = perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            wp.compile_aot_module(module, arch=arch, module_dir=folder, use_ptx=False)
            seconds = perf_counter() - start
            binary = next(Path(folder).glob("*.cubin")).read_bytes()
        row: Row = {"robot": name, "kernel": label, "dtype": batch.dtype.__name__, "arch": arch}
        row |= kernel_numbers(binary, "run_")
        row["compile"] = seconds
        row["operations"] = operations(batch, quantity)
        rows.append(row)
    return rows


# --- numbers in a CUDA binary, an ELF file of 64 bits ---------------------------------------------


class _Section(NamedTuple):
    """The header of a section."""

    name: int  #: Where its name is in the table of names.
    kind: int
    flags: int
    address: int
    offset: int  #: Where it is in the file.
    size: int
    link: int  #: Number of the section that it refers to: for symbols their names.
    info: int
    alignment: int
    entry_size: int


#: Layout of a `_Section` in the file.
_SECTION = "<IIQQQQIIQQ"
#: Kind of the section with the symbols, and the size of one.
_SYMBOLS = 2
_SYMBOL_SIZE = 24
#: `.nv.info` is a list of records: form, tag, and the length of the value, or the value itself. The
#: value of these records is the number of a symbol and a number about it.
_WITH_LENGTH = 4
_REGISTERS = 0x2F
_STACK = 0x11


def kernel_numbers(binary: bytes, kernel: str) -> Row:
    """Registers, bytes of the stack and bytes of code of the kernel whose name begins so."""
    (table_offset,) = struct.unpack_from("<Q", binary, 40)
    header_size, count, number_of_names = struct.unpack_from("<3H", binary, 58)
    sections = []
    for i in range(count):
        fields = struct.unpack_from(_SECTION, binary, table_offset + header_size * i)
        sections.append(_Section(*fields))

    def text(table: _Section, offset: int) -> str:
        """A name in a table of names, which ends with a zero byte."""
        start = table.offset + offset
        return binary[start : binary.index(b"\0", start)].decode()

    by_name = {text(sections[number_of_names], section.name): section for section in sections}
    symbols = next(section for section in sections if section.kind == _SYMBOLS)
    numbers: Row = {}
    for name, section in by_name.items():
        if name.startswith(f".text.{kernel}"):
            numbers["code"] = section.size

    info = by_name[".nv.info"]
    offset = info.offset
    while offset < info.offset + info.size:
        form, tag, length = struct.unpack_from("<BBH", binary, offset)
        if form == _WITH_LENGTH and tag in (_REGISTERS, _STACK):
            symbol, value = struct.unpack_from("<II", binary, offset + 4)
            symbol_offset = symbols.offset + _SYMBOL_SIZE * symbol
            (name_offset,) = struct.unpack_from("<I", binary, symbol_offset)
            if text(sections[symbols.link], name_offset).startswith(kernel):
                numbers["registers" if tag == _REGISTERS else "stack"] = value
        offset += 4
        if form == _WITH_LENGTH:
            offset += length
    return numbers


def resource_table(rows: list[Row]) -> list[tuple[str, ...]]:
    """Resources of machine code, in a form to read."""
    head = ("operations", "registers", "stack, bytes", "code, kB")
    lines = [("robot", "numbers", "kernel", *head)]
    for row in rows:
        numbers = row["operations"], row["registers"], row["stack"], round(row["code"] / 1000)
        lines.append((row["robot"], row["dtype"], row["kernel"], *map(str, numbers)))
    return lines
