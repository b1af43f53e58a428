# SPDX-License-Identifier: BSD-2-Clause
"""Kernels as C99: straight-line code on `real`, a number or a vector of samples.

- `c_statements` writes the statements of a kernel;
- `body` makes functions of these statements;
- `library` makes the sources of a library from these functions and from *templates*. Templates are
  files of the folder `c`; their blanks, such as ${name}, get the texts and numbers of a kernel.

In the C, `number` is one number and `real` one number or a vector of numbers (c/real.h). Arrays of
the functions:

    x   the inputs of a sample, one after the other
    p   the symbolic parameters, then constants that are computed from them alone
    y   results and checks, then intermediate results

A kernel *along directions* computes a matrix column by column (`along_directions`). Its C consists
of a function that runs *once* for a sample, and of *passes*, functions that compute the columns of
a group of coordinates. A pass has two more arrays:

    d   the direction: a rate for each coordinate of the pass
    o   the array y of the function that runs once
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.resources import files
from string import Template
from typing import NamedTuple

from ..loops.continuity import TRAVEL
from ..model.thresholds import BEND, CLOSURE_TOLERANCE
from . import statements
from .along_directions import Directions
from .c_statements import OF_PARAMETERS, OF_SAMPLE, written
from .compiled_states import CHANGE, NEARBY
from .kernel_checks import CLOSED
from .kernels import SymbolicKernel
from .recomputation import with_addresses_again, with_cheap_results_again

#: Arguments of the function of a pass.
_OF_PASSES = (
    "const number *restrict x, parameters p, const number *restrict o, const real *d, "
    "real *restrict y"
)


def part(name: str) -> str:
    """The text of a file of the folder `c`."""
    return (files(__package__) / "c" / name).read_text(encoding="utf-8")


def filled(name: str, values: Mapping[str, object]) -> str:
    """The text of a file of the folder `c` with its blanks filled in."""
    return Template(part(name)).substitute(values)


class Style(NamedTuple):
    """A precision of numbers: how C writes them, and thresholds."""

    type: str  #: The type in C.
    suffix: str  #: The suffix of literals.
    digits: int  #: Decimal digits that determine a number.
    head: str  #: The first lines of a source.
    closed: float  #: Largest residual of closed loops, free of units.
    rounding: float  #: Relative rounding.
    angle: float  #: Largest entry of q: sines of larger angles lose digits.
    dtype: str  #: The type in NumPy and Warp.
    #: After a Newton step up to this length, free of units, loops are closed: the next step would
    #: be about its square, which is below rounding.
    last_step: float

    @property
    def tolerance(self) -> float:
        """Tolerance of closed loops; kernels accept residuals up to half of it, `closed`."""
        return 2 * self.closed


STYLES = {
    "double": Style(
        type="double",
        suffix="",
        digits=17,
        head="",
        closed=CLOSED,
        rounding=2.0**-52,
        angle=1e6,
        dtype="float64",
        last_step=1e-8,
    ),
    "single": Style(
        type="float",
        suffix="f",
        digits=9,
        head="#define SINGLE\n",
        closed=1e-4,  # angles that are rounded to 24 bits leave loops open by some 1e-6
        rounding=2.0**-23,
        angle=1e3,
        dtype="float32",
        last_step=1e-5,
    ),
}


class KernelSource(NamedTuple):
    """The C of a kernel; c/real.h has the types.

    Every kernel has a function that computes the constants in p from the parameters:

        void <name>_constants(constants p)

    A kernel along directions has a function that runs once for a sample, and one for each pass:

        void <name>_once(const real *x, parameters p, real *y)
        void <name>_pass_<k>(x, p, const number *o, const real *d, real *y)

    Each of them can be compiled by itself. Any other kernel has one function that computes its
    results and checks:

        void <name>(const real *x, parameters p, real *y)
    """

    #: The function of constants. After it stands the function of the kernel, unless the kernel is
    #: along directions.
    text: str
    #: Size of p.
    p_size: int
    #: Size of y in the function of the kernel; along directions, in the function that runs once.
    y_size: int
    #: For a kernel along directions: the function that runs once, then the passes.
    functions: tuple[str, ...] = ()
    #: The largest size of y in a pass; 0 without passes.
    y_size_of_passes: int = 0


def body(
    kernel: SymbolicKernel,
    p_size: int | None = None,
    suffix: str = "",
    *,
    in_memory: bool = False,
    recompute: bool = False,
) -> KernelSource:
    """The C of a kernel.

    Args:
        kernel: The kernel.
        p_size: Size of p before the constants of this kernel; by default the number of parameters.
        suffix: The suffix of literals, "f" in single precision.
        in_memory: Whether intermediate results that are used much later are kept in an array, by
            `statements.with_results_in_memory`, in GNU C.
        recompute: Whether cheap results and addresses are computed again instead of kept, for GPUs.
            Functions that are divided into parts (`_function`) stay as they are.
    """
    writer = written(kernel, p_size, suffix)
    name = kernel.name
    constants = statements.function(
        f"static void {name}_constants(constants p)", ["(void)p;", *writer.lines[OF_PARAMETERS]]
    )
    arrange = statements.with_results_in_memory if in_memory else list
    is_along = kernel.along is not None
    # Along directions, this is the function that runs once for a sample. Otherwise it is the
    # function of the kernel.
    once = _function(
        storage="SEPARATE" if is_along else "static",
        name=f"{name}_once" if is_along else name,
        arguments="const real *x, parameters p, real *restrict y",
        lines=writer.lines[OF_SAMPLE],
        y_entries=writer.y_size,
        arrange=arrange,
        recompute=recompute,
    )
    if kernel.along is None:
        return KernelSource(f"{constants}\n{once.text}", writer.p_size, once.y_size)
    passes = []
    for k, one in enumerate(kernel.along.passes):
        function = _function(
            storage="SEPARATE",
            name=f"{name}_pass_{k}",
            arguments=_OF_PASSES,
            lines=writer.lines[k],
            y_entries=one.results.numel() + one.checks.numel(),
            arrange=arrange,
            recompute=recompute,
        )
        passes.append(function)
    return KernelSource(
        text=constants,
        p_size=writer.p_size,
        y_size=once.y_size,
        functions=(once.text, *(function.text for function in passes)),
        y_size_of_passes=max(function.y_size for function in passes),
    )


class _Function(NamedTuple):
    """The C of a function."""

    text: str
    #: Size of its array y.
    y_size: int


def _function(
    *,
    storage: str,
    name: str,
    arguments: str,
    lines: Sequence[str],
    y_entries: int,
    arrange: Callable[[Sequence[str]], list[str]],
    recompute: bool,
) -> _Function:
    """A function of some statements.

    A long function is divided into parts, each a function of its own. A part hands intermediate
    results on to later parts in an array w: the end of y, after its first `y_entries` entries.

    Args:
        storage: "static", or SEPARATE (c/real.h) for a function that can be compiled by itself.
        name: Its name.
        arguments: Its arguments in C.
        lines: Its statements.
        y_entries: Number of entries of y that the statements write.
        arrange: Returns the statements of one function in another form: it decides where the
            compiler keeps intermediate results.
        recompute: As in `body`.
    """
    # The names of the arguments, without their types.
    names = [argument.split()[-1].lstrip("*") for argument in arguments.split(", ")]
    # An argument that is not used would cause a warning of the compiler.
    unused = " ".join(f"(void){x};" for x in names if x != "y")
    head = f"{storage} void {name}({arguments})"
    if len(lines) <= statements.LARGEST:
        if recompute:
            lines = with_addresses_again(with_cheap_results_again(lines))
        body_lines = arrange(statements.with_sines_together(lines))
        return _Function(statements.function(head, [unused, *body_lines]), y_entries)
    parts, handed_on = statements.in_parts(statements.pieces(lines))
    texts: list[str] = []
    calls: list[str] = []
    for k, part_lines in enumerate(parts):
        head_of_part = f"PART {name}_{k}({arguments}, real *restrict w)"
        lines_of_part = [f"{unused} (void)w;", *arrange(part_lines)]
        texts.append(statements.function(head_of_part, lines_of_part))
        calls.append(f"{name}_{k}({', '.join(names)}, y + {y_entries});")
    texts.append(statements.function(head, calls))
    return _Function("\n".join(texts), y_entries + handed_on)


class KernelSources(NamedTuple):
    """The C of several kernels, which share p; the members are those of `KernelSource`."""

    #: The text of each kernel.
    texts: list[str]
    #: The functions of a kernel along directions.
    functions: list[str]
    #: Size of p: the parameters, then the constants of each kernel.
    p_size: int
    #: The largest size of y.
    y_size: int
    #: The largest size of y in a pass.
    y_size_of_passes: int


def bodies(
    kernels: Sequence[SymbolicKernel],
    suffix: str = "",
    *,
    in_memory: bool = False,
    recompute: bool = False,
) -> KernelSources:
    """The C of several kernels; the arguments are those of `body`."""
    sources = list[KernelSource]()
    p_size = None  # each kernel adds its constants to p, so the last size is the size of p
    for kernel in kernels:
        source = body(kernel, p_size, suffix, in_memory=in_memory, recompute=recompute)
        p_size = source.p_size
        sources.append(source)
    return KernelSources(
        texts=[source.text for source in sources],
        functions=[text for source in sources for text in source.functions],
        p_size=sources[-1].p_size,
        y_size=max(source.y_size for source in sources),
        y_size_of_passes=max(source.y_size_of_passes for source in sources),
    )


def library(entry: str, kernels: Sequence[SymbolicKernel]) -> list[str]:
    """Sources of the library of a kernel, or of "closing" and "state_rate" for rollouts.

    The library has

    - `prepare_<entry>`, which computes the constants in p;
    - `run_<entry>`, which runs the kernel on many samples, or makes the steps of rollouts;
    - `sizes_run_<entry>`, the sizes of p, of the output, and of each input of `run`, then -1;
    - for rollouts `rate_<entry>`, which runs "state_rate" on many samples with q and va in one
      array, and `sizes_rate_<entry>`.

    An option of the compiler defines LANES, the number of samples that are computed at once. In a
    kernel along directions, the passes compute this number of directions of one sample at once.
    """
    sources = bodies(kernels, in_memory=True)
    # `closing` is empty, or for rollouts a list of the kernel "closing".
    *closing, kernel = kernels
    sizes = [symbols.numel() for symbols in kernel.inputs.values()]
    outputs = kernel.output.numel()
    blanks: dict[str, object] = {
        "entry": entry,
        "calls": "\n    ".join(f"{each.name}_constants(p);" for each in kernels),
        "p_size": sources.p_size,
        "name": kernel.name,
        "q": sizes[0],
        "inputs": sum(sizes),
        "outputs": outputs,
        "results": outputs,  # along directions, `blanks_of_directions` has the size of the matrix
        "checks": kernel.checks.numel(),
        "y_size": sources.y_size,
    }
    if closing:
        entry_functions = _entries_of_rollouts(closing[0], sizes, blanks)
    elif kernel.along is not None:
        of_passes = _blanks_of_passes(kernel.name, kernel.along)
        of_passes["y_size_of_passes"] = sources.y_size_of_passes
        blanks |= blanks_of_directions(kernel.along)
        entry_functions = _entry("along.c", "run", sizes, blanks | of_passes)
    else:
        entry_functions = _entry("run.c", "run", sizes, blanks | {"close": "NULL"})
    head = part("real.h")
    driver = [head, part("distances.h"), part("driver.h")]
    prepare = filled("entries/prepare.c", blanks)
    first_source = "\n".join([*driver, *sources.texts, prepare, *entry_functions])
    if not sources.functions:
        return [first_source]
    once, *passes = sources.functions
    # The function that runs once computes one sample. With one lane, its `real` is `number`.
    once_source = f"#undef LANES\n#define LANES 1\n{head}\n{once}"
    return [first_source, once_source, *(f"{head}\n{text}" for text in passes)]


def _entry(
    template: str, word: str, sizes: Sequence[int], blanks: Mapping[str, object]
) -> list[str]:
    """The function `<word>_<entry>` of a library, and the sizes of its arrays.

    Args:
        template: Name of its file in the folder `c/entries`.
        word: "run" or "rate".
        sizes: Sizes of the inputs.
        blanks: Texts for the other blanks.
    """
    of_entry: dict[str, object] = {"word": word, "sizes": listed(sizes), "arrays": len(sizes)}
    return [filled(f"entries/{name}", {**blanks, **of_entry}) for name in (template, "sizes.c")]


def _entries_of_rollouts(
    closing: SymbolicKernel, sizes: Sequence[int], blanks: Mapping[str, object]
) -> list[str]:
    """The functions of rollouts: "run" makes steps, "rate" runs "state_rate".

    Args:
        closing: The kernel "closing".
        sizes: Sizes of the inputs of "state_rate": q, va, tau, and the external wrenches if they
            are an input.
        blanks: Texts for blanks of "state_rate".
    """
    q, va, tau, *load = sizes
    of_steps: dict[str, object] = {
        "va": va,
        "tau": tau,
        "load": sum(load),
        "states": q + va,
        "close": closing.name,
        "close_checks": closing.checks.numel(),
        "units": listed(closing.units),
        # Bounds of a sound step, which stays in its assembly mode: c/driver.h has the formulas.
        "bend": BEND,
        "tolerance": CLOSURE_TOLERANCE,
        "travel": TRAVEL,
        "nearby": NEARBY * TRAVEL,
        "change": CHANGE,
    }
    steps = _entry("roll.c", "run", sizes, {**blanks, **of_steps})
    rate = _entry("run.c", "rate", [q + va, tau, *load], {**blanks, "close": closing.name})
    return [*steps, *rate]


def _blanks_of_passes(name: str, along: Directions) -> dict[str, object]:
    """Texts for the blanks that list the passes of a kernel in C."""
    declarations = [f"void {name}_once(const number *x, parameters p, number *restrict y);"]
    passes = []
    for k, one in enumerate(along.passes):
        declarations.append(f"void {name}_pass_{k}({_OF_PASSES});")
        sizes = (len(one.coordinates), len(one.places), one.checks.numel())
        arrays = f"directions_{k}, places_{k}, strides_{k}"
        passes.append(f"{{{name}_pass_{k}, {listed(sizes)}, {arrays}}}")
    return {"declarations": "\n".join(declarations), "passes": ", ".join(passes)}


def blanks_of_directions(along: Directions) -> dict[str, object]:
    """Texts for the blanks of the templates of kernels along directions, in C and in Warp.

    The members of `direction_pass` and `directional_kernel` in c/driver.h have the same meanings.
    """
    tables = list[str]()
    order = list[int]()
    entries = list[tuple[int, int]]()
    for k, one in enumerate(along.passes):
        numbers = {
            "directions": one.coordinates,
            "places": [place.first for place in one.places],
            "strides": [place.stride for place in one.places],
        }
        arrays = (f"{name}_{k}[] = {{{listed(x)}}}" for name, x in numbers.items())
        tables.append(f"static const int {', '.join(arrays)};")
    if along.solution is not None:
        order = along.solution.order
        entries = along.solution.entries
    return {
        "results": along.size,
        "tables": "\n    ".join(tables),
        "count": len(along.passes),
        "known_at": listed(along.places),
        "width": along.width,
        "rank": len(order),
        "order": listed(order),
        "entries": len(entries),
        "entry_at": listed([i for entry in entries for i in entry]),
    }


def listed(numbers: Iterable[float]) -> str:
    """Numbers of an array in C, which must not be empty: without numbers it gets a zero."""
    return ", ".join(map(str, numbers)) or "0"
