# SPDX-License-Identifier: BSD-2-Clause
"""Figures, maps, pages and commands asked for what they cannot give."""

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from call_world import World
from judged_calls import Call
from signature_calls import each

import sst_pin
from sst_pin.cli import main

#: Subjects of a page that are drawn from the motion alone, or from the motion and the foot.
FROM_MOTION = ("path", "torques", "joints")


def pictures(w: World) -> Iterator[Call]:
    """Figures, maps and the viewer."""
    from sst_pin import plots
    from sst_pin.sst.workspace import workspace_at, workspace_over_rolls
    from sst_pin.viewer import Viewer

    m, other = w.motion, w.motion_of_another
    for name, motion in (("one sample", m[:1]), ("another robot's motion", other)):
        subjects = [s for s in plots.SUBJECTS if motion is not other or s not in FROM_MOTION]
        yield from each(
            f"motion_page of {name}",
            lambda s, motion=motion: plots.motion_page(w.robot, motion, [s]),
            subjects,
        )
    odd = ([], (), "torques", ["torque"], [None], 5, "unknown", [["torques"]])
    yield from each("motion_page, subjects", lambda s: plots.motion_page(w.robot, m, s), odd)
    yield from each("require_ending", plots.require_ending, ("a.jpg", "a.csv", b"a.png"))
    sizes = ((2, 3), (3, 2), (10**12, 3), (3, 10**12))
    yield from each("workspace_at", lambda size: workspace_at(w.robot, 0.0, *size), sizes)
    yield Call("workspace_over_rolls(10**12)", lambda: workspace_over_rolls(w.robot, 10**12, 3, 3))
    Path("there.npz").write_text("x")
    map_ = workspace_at(w.robot, rings=5, spokes=6)
    yield Call("workspace.save onto what is there", lambda: map_.save("there.npz"))
    yield from each("viewer.show", Viewer(w.robot).show, (m.q[0, :8], m.q, "home"))
    yield Call("viewer.play(of an SST on a chain)", lambda: Viewer(w.chain).play(m))
    yield from each("Viewer", Viewer, (None, "robot", 5))


def commands(w: World) -> Iterator[Call]:
    """The command `sst-pin` in this process: exit code 1 or 2, and one line that says why."""
    w.motion.save("motion.csv", force=True)
    w.motion.save("motion.npz", force=True)
    Path("file").write_text("x")
    Path("empty.csv").write_text("")
    Path("half.csv").write_text("t_s,tau_1_Nm,tau_2_Nm,tau_3_Nm\n0,0,0,0\n1,x,0,0\n")
    Path("still.csv").write_text("t_s,tau_1_Nm,tau_2_Nm,tau_3_Nm\n0,0,0,0\n0.001,0,0,0\n")
    Path("far.csv").write_text(
        "t_s,theta_deg,phi_deg\n" + "".join(f"{i},{170 * i},{170 * i}\n" for i in range(6))
    )
    Path("bad.urdf").write_text(w.urdf.replace('value="0.3"', 'value="0,3"'))
    Path("taken").mkdir()
    (Path("taken") / "sst.urdf").write_text("x")
    long, nul = "a" * 300, "a\0b"
    lines = [
        "--unknown", "paper --samples x", "paper --samples -1", "paper --samples 1e3",
        "paper --samples 99999999999999999999", "paper --samples", "paper extra",
        "paper --out /dev/null/x --samples 10", "info --json --robot bad.urdf",
        "torques motion.csv -o no/such/x.csv", "torques motion.csv -o x.csv --robot bad.urdf",
        "simulate still.csv -o x.csv --q0 a=1", "simulate still.csv -o x.csv --va0 a",
        "simulate still.csv -o x.csv --q0 =1", "simulate still.csv -o x.csv --q0 a=nan",
        "export-c a b c", "export-c no/such/folder", "workspace -o - --data -",
        "torques empty.csv -o x.csv", "torques motion.csv -o", "torques half.csv -o x.csv",
        "torques far.csv -o x.csv", "torques motion.npz -o x.csv", "torques /dev/zero -o x.csv",
        "torques . -o x.csv", f"torques {nul} -o x.csv", f"torques motion.csv -o {nul}.csv",
        "torques motion.csv -o .", "torques motion.csv -o /dev/full",
        "torques motion.csv -o x.csv --robot bad.urdf", "torques motion.csv -o x.csv --robot .",
        "torques motion.csv -o x.csv --robot empty.csv", "simulate", "simulate half.csv -o x.csv",
        "simulate still.csv -o x.csv --q0 a=b", "simulate still.csv -o x.csv --q0 gamma_1=nan",
        "simulate still.csv -o x.csv --q0 gamma_1=1e308 --va0 gamma_1=1e308",
        "simulate still.csv -o x.csv --q0 gamma_1=1,gamma_2=1,gamma_3=1 --va0 gamma_1=1e200",
        "simulate still.csv -o x.txt --q0 gamma_1=1,gamma_2=1,gamma_3=1",
        "simulate empty.csv -o x.csv --q0 gamma_1=0,gamma_2=0,gamma_3=0",
        "simulate motion.csv -o x.csv --q0", "show missing.csv --html x.html",
        "show motion.csv --html x.txt", "show motion.csv --html file/x.html",
        "show motion.csv --speed 0 --html x.html", "show motion.csv --speed -1 --html x.html",
        "show motion.csv --speed nan --html x.html", "show motion.csv --speed inf --html x.html",
        "show motion.csv --speed fast", "show motion.csv --port x --no-open",
        "show motion.csv --host nowhere.invalid --no-open",
        "show motion.csv --host 192.0.2.1 --no-open", f"show motion.csv --host {long} --no-open",
        "show --live --port 99999 --no-open",
        "show --live --host nowhere.invalid --no-open",
        "show --robot missing.urdf --html x.html", "show --robot bad.urdf --html x.html",
        "show --robot missing.xml --html x.html", "show motion.csv --html motion.csv",
        "show motion.csv --png x.html", "show empty.csv --html x.html",
        "plot motion.csv -o x.png --what ,", "plot motion.csv -o file/x.png", "plot file -o x.png",
        "plot . -o x.png", "plot motion.csv -o /dev/null/x.png", f"plot motion.csv -o {long}.png",
        "workspace -o x.png --psi inf", "workspace -o x.png --psi 1,2", "describe",
        "describe -o taken", "describe -o file", "describe -o x --alpha -120,240,240",
        "describe -o x --alpha nan,1,2", "describe -o x --link-mass -1",
        "describe -o x --link-mass nan", "describe -o x --link-mass x",
        "describe -o x --star-mass inf", "describe -o x --viscous-friction -1",
        "describe -o x --coulomb-friction nan", "describe -o x --base-radius 0",
        "describe -o x --base-radius nan", "describe -o x --star-radius 1e-320",
        "describe -o x --star-radius -1", "describe -o x --gravity 1,2",
        "describe -o x --gravity inf,0,0", "describe -o x --robot bad.urdf", f"describe -o {nul}",
        "verify --robot missing.urdf", "verify extra", "verify --quick --robot bad.urdf",
        "validate", "validate missing.urdf", "validate file", "validate bad.urdf", "validate .",
        "validate /dev/zero", f"validate {long}", f"validate {nul}",
        "validate bad.urdf --cuts missing.yaml", "validate bad.urdf --cuts .",
        "validate bad.urdf --cuts bad.urdf", "export-c file", "export-c x --robot missing.urdf",
        "export-c x --robot bad.urdf", f"export-c {nul}", "export-c /dev/null/x",
        "info --robot bad.urdf", "info extra", "info --urdf", f"info --robot {nul}",
        f"info --robot {long}",
    ]  # fmt: skip
    directions = ("describe", "-o", "x", "--base-directions")
    for argv in (
        *(line.split(" ") if line else [] for line in lines),
        [*directions, "1,0,0 0,1,0 0,0,nan"],
        [*directions, "1,0,0 0,1,0"],
        ["torques", "\udcff.csv", "-o", "x.csv"],
        ["torques", "", "-o", "x.csv"],
        ["torques", "motion.csv", "-o", ""],
    ):
        line = ascii(" ".join(argv))
        label = line if len(line) < 90 else line[:70] + "..."
        yield Call(f"sst-pin {label}", lambda x=argv: _command(x))


def _command(argv: list[str]) -> Any:
    """Code, output and errors, when they are not those of a command that says what is wrong."""
    out, err = io.StringIO(), io.StringIO()
    before = set(map(str, Path().iterdir()))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main(argv)
        except SystemExit as stop:
            code = stop.code
    said = err.getvalue().rpartition("\r")[2].strip().splitlines()  # after a bar of progress
    told = len(said) == 1 and said[0].startswith("sst-pin")
    listed = code == 1 and argv[0] == "validate" and not said and "error(s)" in out.getvalue()
    left = {name for name in set(map(str, Path().iterdir())) - before if name.startswith(".")}
    if ((code == 2 and told) or listed) and not left:
        raise sst_pin.SSTError(said[0] if said else out.getvalue().strip().splitlines()[-1])
    return code, out.getvalue()[-80:], err.getvalue()[-200:], left
