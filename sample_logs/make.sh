#!/usr/bin/env bash
# Make the sample logs anew, in the folder given or in this one. The same hrclog makes the same events.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
out=${1:-$here}
hrclog=${HRCLOG:-hrclog}
python=${PYTHON:-python}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

rm -rf "$out"/campaign "$out"/*.mcap "$out"/*.partial "$out"/study.csv
"$hrclog" sim --scenario paper --runs 12 --seed 1 -o "$out/campaign"
for sample in "single paper 7" "failures failures 3" "three_agents three-agents 5"; do
  read -r name scenario seed <<<"$sample"
  "$hrclog" sim --scenario "$scenario" --runs 1 --seed "$seed" -o "$work/$name"
  mv "$work/$name"/*.mcap "$out/$name.mcap"
done
for sample in "cell_areas paper areas" "cell_ssm kitting ssm"; do
  read -r name scenario safety <<<"$sample"
  "$hrclog" sim --scenario "$scenario" --engine bullet --safety "$safety" --signals-hz 5 --runs 1 --seed 2 -o "$work/$name"
  mv "$work/$name"/*.mcap "$out/$name.mcap"
done
"$python" "$here/ros2_actions.py" "$out"
"$python" "$here/study.py" "$out/study.csv"
"$hrclog" import table "$out/study.csv" -o "$work/study"
mv "$work/study/P03_shared_2.mcap" "$out/imported.mcap"
"$python" "$here/broken_off.py" "$out/broken_off.mcap"
"$python" "$here/killed.py" "$out/killed.mcap"
