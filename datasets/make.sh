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
