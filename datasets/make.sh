#!/usr/bin/env bash
# Make the example recordings again, on the virtual bench with fixed seeds.
# Usage: datasets/make.sh [folder]   (a new folder; datasets/ itself when it holds no run yet)
set -euo pipefail
cd "$(dirname "$0")/.." # addresses are kept with the runs, so no path of one machine may stand in them
out=${1:-datasets}
benchtool=${BENCHTOOL:-benchtool}

make_run() {
    local name=$1
    shift
    "$benchtool" sweep "$@" --yes --operator "virtual bench" --name "$name" --out "$out/$name/run"
    rm "$out/$name/run/samples.csv" # samples.parquet holds the same rows in a tenth of the space
}

distances=0.6,0.8,1,1.5,2,3,4,5
make_run single_rotor "sim:pquad_single?truth=virtual_pquad_single&seed=11&rate=40" \
    --z-over-r $distances --pwm 1450,1600 --repeats 9
make_run amuse_rotor "sim:amuse_single?truth=virtual_amuse_single&seed=15&rate=40" \
    --z-over-r $distances --pwm 1450,1600 --repeats 9
make_run three_rotors "sim:pquad?truth=virtual_pquad&seed=12&rate=40" \
    --z-over-r $distances --pwm 1450,1600 --rotors 1,2,3 --repeats 5
make_run quad "sim:pquad?truth=virtual_pquad&seed=13&rate=40" \
    --z-over-r $distances --pwm 1450,1600 --repeats 5
make_run partial_area "sim:pquad_single?truth=datasets/partial_area/truth.toml&seed=14&rate=40" \
    --z-over-r 0.6,0.8,1 --lateral 0,0.5515,0.6,0.6485 --pwm 1600 --repeats 9

# A pitch bench whose hinge drags, small imperfections beside it; the model does not know.
make_pitch() {
    local name=$1
    shift
    local made="$out/pitch_friction/$name.made"
    "$benchtool" simulate pitch --model datasets/pitch_bench/model.toml --gains stiff --controllers pid \
        --set coulomb_friction.torque_Nm=0.012 --set inertia_kgm2=0.0306 --set cog_offset.x_m=0.0002 \
        --set rotor_asymmetry.ratio=1.004 --set gyro_bias.bias_rad_s=0.0009 --out "$made" "$@"
    # Parquet holds the same rows in a fifth of the space.
    "${PYTHON:-python3}" - "$made/pid.csv" "$out/pitch_friction/$name.parquet" <<'PYTHON'
import sys
from pathlib import Path

from benchtool import __version__
from benchtool.store import read_recording, write_recording

made, kept = map(Path, sys.argv[1:])
write_recording(kept, read_recording(made), {"software": f"benchtool {__version__}"})
PYTHON
    rm -r "$made"
}

make_pitch learn --schedule identify --duration-s 30 --seed 21
make_pitch check --schedule datasets/pitch_friction/check.toml --seed 22
