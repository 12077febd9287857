"""An OpenFOAM case of the paper's figure 5: fixed-velocity discs over ground, a quarter of it all.

The paper's own simplification (section 2.2): rotors as discs of constant velocity, a solid box as
body, no rotation. Two planes of symmetry leave one rotor. Steady, incompressible, k-omega SST. Ten
cells to a radius make half a million cells; run it with ./Allrun where OpenFOAM is installed.
benchtool writes the case and does not run it: look at its residuals before believing it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from pathlib import Path

from benchtool.core.counted import counted
from benchtool.core.rig import Rig
from benchtool.errors import InputError
from benchtool.report.files import refuse_existing, write_whole
from benchtool.simulate.rigid_body import GRAVITY_M_S2

AIR_DENSITY_KG_M3 = 1.225
"""Standard atmosphere at sea level."""

AIR_VISCOSITY_M2_S = 1.5e-5
"""Kinematic viscosity of air at 20 degrees, rounded."""

CELLS = (3, 40)
"""Fewest and most cells to a rotor radius: a disc needs a few, a laptop has memory for so many."""

ITERATIONS = (1, 100_000)
"""Fewest and most iterations that make sense; coarse meshes settled within one thousand."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlowCase:
    """Say what is computed: lengths in m, the disc's velocity in m/s.

    Attributes:
        radius_m, spacing_m, height_m: of the rotors, of their axes, of the discs over ground.
        velocity_m_s: downward, in the discs.
        cells_per_radius: of the uniform mesh; a choice, ten show the shear layers.
        iterations: at which the solver stops at the latest.
    """

    radius_m: float
    spacing_m: float
    height_m: float
    velocity_m_s: float
    cells_per_radius: int = 10
    iterations: int = 2000

    def __post_init__(self) -> None:
        for name, value, (low, high) in (
            ("cells_per_radius", self.cells_per_radius, CELLS),
            ("iterations", self.iterations, ITERATIONS),
        ):
            if not low <= value <= high:
                raise InputError(f"{name} is {value}; give {low} to {high}")

    @classmethod
    def of_rig(
        cls, rig: Rig, z_over_R: float = 2.0, cells_per_radius: int = 10, iterations: int = 2000
    ) -> FlowCase:
        """Return the case of a quadrotor at a height, with the induced velocity of its hover."""
        if rig.n_discs != 4 or rig.n_rotors != 4:
            raise InputError(
                f"rig {rig.name!r} has {counted(rig.n_rotors, 'rotor')}; the case needs four"
            )
        if not 0.5 <= z_over_R <= 6.0:
            raise InputError(f"z/R is {z_over_R:g}; the case's domain holds 0.5 to 6")
        radius = rig.propulsion.radius_m
        area = pi * radius * radius
        lift = rig.body.mass_kg * GRAVITY_M_S2 / rig.n_rotors
        spacing = float(sorted(set(rig.disc_distances_m[0].round(9)))[1])
        velocity = sqrt(lift / (2.0 * AIR_DENSITY_KG_M3 * area))
        return cls(
            radius_m=radius,
            spacing_m=spacing,
            height_m=z_over_R * radius,
            velocity_m_s=velocity,
            cells_per_radius=cells_per_radius,
            iterations=iterations,
        )


def case_files(case: FlowCase) -> dict[str, str]:
    """Return the files of the case by their path in its folder."""
    R, z, s = case.radius_m, case.height_m, 0.5 * case.spacing_m
    far, top, cell = 8.0 * R, z + 5.0 * R, R / case.cells_per_radius
    n, m = round(far / cell), round(top / cell)
    v = case.velocity_m_s
    k = 1.5 * (0.02 * v) ** 2
    omega = sqrt(k) / (0.09**0.25 * 0.1 * R)
    # Half the body's height; in a coarse mesh at least what holds the centres of a layer of cells.
    tall = max(0.12 * R, 0.55 * cell)
    body = f"(0 0 {z - tall:.6g}) ({0.5 * R:.6g} {0.5 * R:.6g} {z + tall:.6g})"
    thickness = 1.5 * cell
    disc = f"p1 ({s:.6g} {s:.6g} {z - thickness:.6g}); p2 ({s:.6g} {s:.6g} {z + thickness:.6g});"
    open_box = {"far": "far", "top": "top"}
    walls = ("ground", "body")

    def boundary(wall: str, opening: str) -> str:
        lines = [f"    {name} {{ {wall} }}" for name in walls]
        lines += [f"    {name} {{ {opening} }}" for name in open_box]
        lines += ["    middleX { type symmetryPlane; }", "    middleY { type symmetryPlane; }"]
        return "boundaryField\n{\n" + "\n".join(lines) + "\n}\n"

    def field(name: str, kind: str, dimensions: str, value: str, wall: str, opening: str) -> str:
        head = _head(f"vol{kind}Field", name)
        return f"{head}dimensions {dimensions};\ninternalField uniform {value};\n" + boundary(
            wall, opening
        )

    def in_and_out(value: str) -> str:
        return f"type inletOutlet; inletValue uniform {value}; value uniform {value};"

    def wall_function(name: str, value: str) -> str:
        return f"type {name}WallFunction; value uniform {value};"

    return {
        "0/U": field(
            "U", "Vector", "[0 1 -1 0 0 0 0]", "(0 0 0)", "type noSlip;",
            "type pressureInletOutletVelocity; value uniform (0 0 0);",
        ),
        "0/p": field(
            "p", "Scalar", "[0 2 -2 0 0 0 0]", "0", "type zeroGradient;",
            "type totalPressure; p0 uniform 0; value uniform 0;",
        ),
        "0/k": field(
            "k", "Scalar", "[0 2 -2 0 0 0 0]", f"{k:.6g}", wall_function("kqR", f"{k:.6g}"),
            in_and_out(f"{k:.6g}"),
        ),
        "0/omega": field(
            "omega", "Scalar", "[0 0 -1 0 0 0 0]", f"{omega:.6g}",
            wall_function("omega", f"{omega:.6g}"), in_and_out(f"{omega:.6g}"),
        ),
        "0/nut": field(
            "nut", "Scalar", "[0 2 -1 0 0 0 0]", "0", wall_function("nutk", "0"),
            "type calculated; value uniform 0;",
        ),
        "constant/transportProperties": _head("dictionary", "transportProperties")
        + f"transportModel Newtonian;\nnu [0 2 -1 0 0 0 0] {AIR_VISCOSITY_M2_S:g};\n",
        "constant/turbulenceProperties": _head("dictionary", "turbulenceProperties")
        + "simulationType RAS;\nRAS { RASModel kOmegaSST; turbulence on; printCoeffs on; }\n",
        "constant/fvOptions": _head("dictionary", "fvOptions")
        + "disc\n{\n    type vectorFixedValueConstraint;\n    active yes;\n"
        + "    selectionMode cellZone;\n    cellZone disc;\n"
        + f"    fieldValues {{ U (0 0 {-v:.6g}); }}\n}}\n",
        "system/blockMeshDict": _head("dictionary", "blockMeshDict")
        + "scale 1;\nvertices\n(\n"
        + "".join(
            f"    ({x:.6g} {y:.6g} {h:.6g})\n"
            for h in (0.0, top)
            for x, y in ((0.0, 0.0), (far, 0.0), (far, far), (0.0, far))
        )
        + f");\nblocks ( hex (0 1 2 3 4 5 6 7) ({n} {n} {m}) simpleGrading (1 1 1) );\n"
        + "edges ();\nboundary\n(\n"
        + "    ground { type wall; faces ((0 3 2 1)); }\n"
        + "    top { type patch; faces ((4 5 6 7)); }\n"
        + "    far { type patch; faces ((1 2 6 5) (2 3 7 6)); }\n"
        + "    middleX { type symmetryPlane; faces ((0 4 7 3)); }\n"
        + "    middleY { type symmetryPlane; faces ((0 1 5 4)); }\n"
        + "    body { type wall; faces (); }\n);\n",
        "system/topoSetDict": _head("dictionary", "topoSetDict")
        + "actions\n(\n"
        + "    { name air; type cellSet; action new; source boxToCell; "
        + f"sourceInfo {{ box {body}; }} }}\n"
        + "    { name air; type cellSet; action invert; }\n"
        + "    { name disc; type cellSet; action new; source cylinderToCell; "
        + f"sourceInfo {{ {disc} radius {R:.6g}; }} }}\n"
        + "    { name disc; type cellZoneSet; action new; source setToCellZone; "
        + "sourceInfo { set disc; } }\n);\n",
        "system/controlDict": _head("dictionary", "controlDict")
        + "application simpleFoam;\nstartFrom latestTime;\nstartTime 0;\nstopAt endTime;\n"
        + f"endTime {case.iterations};\ndeltaT 1;\nwriteControl timeStep;\n"
        + f"writeInterval {min(1000, case.iterations)};\npurgeWrite 2;\n"
        + "functions\n{\n    centreLine\n    {\n        type sets; libs (sampling);\n"
        + "        writeControl writeTime; setFormat raw; interpolationScheme cellPoint;\n"
        + "        fields (U);\n        sets ( centre { type uniform; axis z; "
        + f"start ({0.01 * R:.6g} {0.01 * R:.6g} {0.01 * R:.6g}); "
        + f"end ({0.01 * R:.6g} {0.01 * R:.6g} {z:.6g}); nPoints 81; }} );\n    }}\n}}\n",
        "system/fvSchemes": _head("dictionary", "fvSchemes")
        + "ddtSchemes { default steadyState; }\ngradSchemes { default Gauss linear; }\n"
        + "divSchemes\n{\n    default none;\n    div(phi,U) bounded Gauss linearUpwind grad(U);\n"
        + "    div(phi,k) bounded Gauss upwind;\n    div(phi,omega) bounded Gauss upwind;\n"
        + "    div((nuEff*dev2(T(grad(U))))) Gauss linear;\n}\n"
        + "laplacianSchemes { default Gauss linear corrected; }\n"
        + "interpolationSchemes { default linear; }\nsnGradSchemes { default corrected; }\n"
        + "wallDist { method meshWave; }\n",
        "system/fvSolution": _head("dictionary", "fvSolution")
        + "solvers\n{\n    p { solver GAMG; smoother GaussSeidel; tolerance 1e-7; relTol 0.05; }\n"
        + '    "(U|k|omega)" { solver smoothSolver; smoother symGaussSeidel; tolerance 1e-8; '
        + "relTol 0.1; }\n}\n"
        + "SIMPLE\n{\n    nNonOrthogonalCorrectors 0; consistent yes;\n"
        # Not of U: its residual counts the cells whose velocity is prescribed, and stays.
        + '    residualControl { p 1e-5; "(k|omega)" 1e-5; }\n}\n'
        + 'relaxationFactors { equations { U 0.8; "(k|omega)" 0.7; } }\n',
        "Allrun": _ALLRUN,
        "README.md": _readme(case),
    }  # fmt: skip


_ALLRUN = """#!/bin/sh
# Mesh, cut the body out, solve; Debian's package is found without its environment being set.
set -e
cd "$(dirname "$0")"
if [ -z "$WM_PROJECT_DIR" ] && [ -d /usr/share/openfoam/etc ]; then
    export WM_PROJECT_DIR=/usr/share/openfoam
fi
blockMesh
topoSet
subsetMesh -overwrite -patch body air
simpleFoam
"""


def write_case(out: Path, case: FlowCase) -> list[Path]:
    """Write the case into a folder; refuses to write over anything."""
    files = case_files(case)
    paths = [out / name for name in files]
    refuse_existing(paths)
    for path, text in zip(paths, files.values(), strict=True):
        write_whole(path, text.encode())
    (out / "Allrun").chmod(0o755)
    return paths


def _head(kind: str, name: str) -> str:
    return f"FoamFile {{ version 2.0; format ascii; class {kind}; object {name}; }}\n"


def _readme(case: FlowCase) -> str:
    return (
        f"# Quarter of a quadrotor over ground\n\n"
        f"R = {case.radius_m:g} m, spacing {case.spacing_m:g} m, height {case.height_m:g} m "
        f"(z/R = {case.height_m / case.radius_m:g}).\n"
        f"Discs blow downward with {case.velocity_m_s:.3g} m/s, the induced velocity of hover: the "
        f"paper used the measured mean and does not print it.\n\n"
        f"{case.cells_per_radius} cells to a radius, at most {case.iterations} iterations. Run "
        f"`./Allrun` where OpenFOAM (v1912 or later) is installed. It writes the velocity on "
        f"the centre line into postProcessing/centreLine, to hold against `benchtool flow table`. "
        f"The residuals of U stay near 0.01, because they count the cells whose velocity is "
        f"prescribed; look at those of p and at the centre line.\n"
    )
