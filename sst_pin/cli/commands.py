# SPDX-License-Identifier: BSD-2-Clause
"""All commands with their options, and `run`, which runs one of them.

The function of a command has the command's name, in the module that `COMMANDS` gives. The module is
imported when the command runs, so that `--help` is quick.
"""

import sys
import warnings
from argparse import SUPPRESS
from collections.abc import Sequence
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path

from ..errors import DescriptionWarning, SingularityWarning, SSTError
from ..version import __version__
from .parser import Command, Parser, directions, named_numbers, names_robot, numbers, option, words

_FILES = "URDF, SDF, MJCF, or a name of the gallery (default: the SST)"
_ROBOT = option("--robot ROBOT", _FILES)
_MODEL = option("--model NAME", "the model of an SDF with several that move")
_FORCE = option("--force", "replace existing files")
_STRICT = option("--strict", "refuse what the robot cannot execute; exit code 1")
#: Parameters that `identify` considers by default: masses and first moments (mass, mx, ...),
#: moments of inertia (ixx, ...) and friction. Those of lines are added.
PATTERNS = "*.m*,*.i*,*.viscous,*.coulomb"
_TABLE = option("-o, --output FILE", ".csv or .npz; - writes CSV", Path, required=True)

COMMANDS = (
    Command(
        "paper",
        "sst_commands",
        "both examples of the paper and their figures",
        _ROBOT,
        option("-o, --output, --out FOLDER", "(default: paper)", Path, default=Path("paper")),
        _FORCE,
        option("--samples N", "samples per period (default: 1001)", int, default=1001),
        _STRICT,
    ),
    Command(
        "torques MOTION.csv -o TORQUES.csv",
        "motion_commands",
        "motor torques of a motion (inverse dynamics)",
        option("motion MOTION.csv", "the motion; - means standard input", Path),
        _ROBOT,
        _MODEL,
        _TABLE,
        _FORCE,
        _STRICT,
        more="The columns are t_s and one for each coordinate, such as crank_rad, crank_deg,\n"
        "slide_m; of an SST also qw, qx, qy, qz, or theta, phi, psi with _rad or _deg.",
    ),
    Command(
        "simulate TORQUES.csv -o MOTION.csv",
        "motion_commands",
        "motion for given torques (direct dynamics)",
        option("torques TORQUES.csv", "the torques; - means standard input", Path),
        _ROBOT,
        _MODEL,
        _TABLE,
        _FORCE,
        option("--q0 JOINT=X,..", "positions at the start, rad or m", named_numbers),
        option("--va0 JOINT=V,..", "rates of the coordinates there", named_numbers),
        _STRICT,
        more="The columns are t_s and one for each motor, such as tau_crank_Nm, or by number,\n"
        "tau_1_Nm (N for a force). The motion starts at the state in the first row, if\n"
        "the file has it (crank_rad, crank_rad_s), else at --q0 and --va0.\n"
        "Exit code 3: the simulation stopped before a singularity.",
    ),
    Command(
        "plot MOTION -o FIGURE",
        "motion_commands",
        "figures of a motion",
        option("motion MOTION", "what `torques` reads, it or `simulate` writes", Path),
        _ROBOT,
        _MODEL,
        option("-o, --output FILE", ".png, .svg or .pdf; - writes PNG", Path, required=True),
        _FORCE,
        option("--what WHAT", "what is drawn", words),
        option("--frame NAME", "the frame of the path (default: platform)"),
        _STRICT,
        more="WHAT is one or more of path, torques, joints, rates, power, energy, condition,\n"
        "with commas between (default: all but power; path needs --frame or an SST).",
    ),
    Command(
        "show [MOTION]",
        "motion_commands",
        "a motion in the browser, or as a page or a picture",
        option("motion MOTION", "default: example 1, or home of ROBOT", Path, nargs="?"),
        _ROBOT,
        option("--model NAME", SUPPRESS),  # the help has a screen of lines; errors name it
        option("--ghost FILE", "a second motion, of a translucent robot", Path),
        option("--speed S", "1 is real time (default: 1; 0.1 of example 1)", float),
        option("--html FILE", "write one page that needs no network", Path),
        option("--png FILE", "write a picture; needs Chromium", Path),
        option("--gif FILE", "write an animation; needs Chromium", Path),
        option("--axes", "show the axes of the joints"),
        option("--frame NAME", "draw the path of this frame (default: platform)"),
        option("--frames", "show the frames of closures; of an SST {0k}..{3k}, {E}"),
        option("--reactions", "show the forces in joints and closures"),
        option("--skeleton", "draw joints, lines and masses instead of shapes"),
        option("--live", "a page that computes: drag, push, simulate; needs CasADi"),
        option("--no-open", "print the URL, open no browser"),
        option("--host HOST", "address of the server (default: this machine)", default="127.0.0.1"),
        option("--port PORT", "port of the server (default: any free one)", int, default=0),
        _FORCE,
        _STRICT,
    ),
    Command(
        "describe -o OUTPUT",
        "sst_commands",
        "any robot as MJCF; an SST also as URDF and meshes",
        _ROBOT,
        _MODEL,
        option("-o, --output OUTPUT", "FILE.xml, or the folder of an SST", Path, required=True),
        _FORCE,
        option("--alpha A1,A2,A3", "angles between the arcs, degrees", numbers),
        option("--base-directions D", "'X,Y,Z X,Y,Z X,Y,Z': from O to each P_k", directions),
        option("--base-radius M", "radius of the base, m", float),
        option("--star-radius M", "radius of the star, m", float),
        option("--link-mass KG", "mass of each actuator link; also scales its inertia", float),
        option("--passive-mass KG", "mass of each passive link; also scales its inertia", float),
        option("--star-mass KG", "mass of the star; also scales its inertia", float),
        option("--viscous-friction D", "viscous friction of all nine joints, N m s/rad", float),
        option("--coulomb-friction F", "Coulomb friction of all nine joints, N m", float),
        option("--gravity X,Y,Z", "in base axes, m/s^2", numbers),
        more="FILE.xml is a closed MJCF for MuJoCo. Options change the parameters of an SST.",
    ),
    Command(
        "validate [ROBOT]",
        "robot_commands",
        "all problems of a robot's files, its mobility and its moving mass",
        option("file ROBOT", _FILES, nargs="?"),
        option("--robot ROBOT", "the same"),
        _MODEL,
        option("--cuts YAML", "its closures and motors (default: YAML of its name)", Path),
    ),
    Command(
        "verify",
        "robot_commands",
        "comparison of the dynamics with independent computations",
        _ROBOT,
        _MODEL,
        option("--quick", "fewer cases"),
        option("--json", "print the table as JSON"),
    ),
    Command(
        "identify LOG.csv -o REPORT.md --cutoff HZ",
        "identify",
        "masses, inertias and friction from measured torques",
        option("log LOG.csv", "the log; - means standard input", Path),
        _ROBOT,
        _MODEL,
        option("-o, --output FILE", "Markdown, a picture beside it", Path, required=True),
        _FORCE,
        option("--cutoff HZ", "cut-off frequency of the low-pass filter", float, required=True),
        option("--which NAMES", f"patterns with commas (default: {PATTERNS}, and lines)"),
        option("--masses BODY=KG,..", "known masses, by the joint of the body", named_numbers),
        option("--decimate N", "filter, and use one of N samples (default: up to 10)", int),
        option("--robust", "let outliers count less"),
        option("--urdf FILE", "write the URDF of --robot with the parameters found", Path),
        more="The log has the columns of a motion and of its torques, as `torques` writes\n"
        "them. Its last third is used for validation only.",
    ),
    Command(
        "compile",
        "robot_commands",
        "compiled kernels of a robot, or C code for a controller",
        _ROBOT,
        _MODEL,
        option("--all", "all kernels, not only torques and accelerations"),
        option("--list", "list the kernels in the cache"),
        option("--clear", "delete all kernels in the cache"),
        option("--export-c FOLDER", "write the dynamics as C code with an example", Path),
        option("--precision P", "format of numbers in C: double (default) or single"),
        _FORCE,
    ),
    Command("robots", "robot_commands", "the names of the gallery, for --robot"),
)
#: What to use instead of a word that is not a command: a synonym, or the name of a removed command.
_SUGGESTIONS = {
    **dict.fromkeys(("info", "mobility", "check"), "sst-pin validate"),
    "run": "sst-pin simulate",
    "gallery": "sst-pin robots",
    "cache": "sst-pin compile --list",
    "export-c": "sst-pin compile --export-c FOLDER",
    "loads": "chain.loads(motion) in Python",
    "workspace": "sst_pin.reach_map in Python",
    "excite": "sst_pin.identification.excitation in Python",
    "calibrate": "sst_pin.identification.calibrate in Python",
}


def run(argv: Sequence[str] | None) -> int:
    """Run the command that the arguments ask for; returns the exit code, as `main` does."""
    words_of_user = sys.argv[1:] if argv is None else list(argv)
    parser = _parser()
    # The command is the first word that is not an option.
    name = next((word for word in words_of_user if not word.startswith("-")), None)
    names = [command.name for command in COMMANDS]
    if name is not None and name not in names:
        parser.exit(2, f"sst-pin: error: no command {name!r}; {_suggestion(name, names)}\n")
    arguments = parser.parse_args(words_of_user)
    if name is None:
        print(parser.format_help(), end="")
        return 0
    module = import_module(f".{arguments.command.module}", __package__)
    function = getattr(module, arguments.command.name)
    try:
        with warnings.catch_warnings():
            # A line on standard output already says that a motion stops early.
            warnings.simplefilter("ignore", SingularityWarning)
            # By default Python shows a warning of one place only once.
            warnings.simplefilter("always", DescriptionWarning)
            warnings.showwarning = lambda message, *_, **__: tell("warning", message)
            return function(arguments) or 0  # some commands return None after success
    except SSTError as error:
        tell("error", " ".join(str(error).split()))
        return 2


def _parser() -> Parser:
    """The parser of all commands."""
    text = "Dynamics of closed-chain robots: torques, simulation, figures, checks."
    parser = Parser(prog="sst-pin", usage="sst-pin COMMAND [OPTIONS]", description=text)
    parser.epilog = "`sst-pin COMMAND --help` shows the options of a command."
    parser.add([(["--version"], {"action": "version", "version": __version__})])
    parser.add_commands(COMMANDS)
    return parser


def tell(kind: str, message: object) -> None:
    """Print an error or a warning in one line."""
    print(f"sst-pin: {kind}: {message}", file=sys.stderr)


def _suggestion(name: str, names: Sequence[str]) -> str:
    """A hint for a word that is not the name of a command."""
    if name in _SUGGESTIONS:
        return f"did you mean {_SUGGESTIONS[name]}?"
    if names_robot(name):
        return f"did you mean sst-pin validate {name}?"
    similar = get_close_matches(name, names, 1)
    if similar:
        return f"did you mean sst-pin {similar[0]}?"
    return f"the commands are {', '.join(names)}"
