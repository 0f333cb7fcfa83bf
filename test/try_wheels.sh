#!/usr/bin/env bash
# Install the wheels in dist into clean environments and use them: without ROS the command, a rig and the diagnosis, with
# the extra `ros` the graph. `make try-wheels`; some minutes, most of them downloads.
set -euo pipefail
dist="$PWD/dist"
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
cd "$folder"

"$PYTHON" -m venv alone
alone/bin/pip install --quiet --disable-pip-version-check "$dist"/jammkle-*.whl
alone/bin/jammkle --version
alone/bin/jammkle rig tensile -o pull > /dev/null
alone/bin/jammkle info pull > /dev/null
alone/bin/jammkle rig pressure --repeats 5 -o healthy > /dev/null
echo 'line_leak_achilles: {conductance_dm3_s_bar: 0.003}' > leak.yaml
alone/bin/jammkle rig pressure --effects leak.yaml --seed 3 -o leaking > /dev/null
alone/bin/jammkle gap diagnose leaking $(printf -- '--since %s ' healthy_*) -o gap --json gap.json > /dev/null
grep -q '"verdict": "EFFECTS"' gap.json
alone/bin/jammkle robot quadruped --urdf | grep -q 'link name="lf_ankle/foot"'
alone/bin/jammkle robot leg --duration-s 1 -o leg > /dev/null
alone/bin/jammkle detect leg > /dev/null
if alone/bin/jammkle status 2> said; then exit 1; fi
grep -q "jammkle\[ros\]" said
echo "without ROS: command, rigs and the diagnosis work"

"$PYTHON" -m venv graph
graph/bin/pip install --quiet --disable-pip-version-check --find-links "$dist" "jammkle[ros,view,foxglove]"
export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST ROS_DOMAIN_ID="${ROS_DOMAIN_ID:-99}"
graph/bin/jammkle up --view --foxglove -p foxglove:port:=0 > up.log 2>&1 &
up=$!
until grep -q "jammkle: up" up.log; do kill -0 "$up" || { cat up.log; exit 1; }; sleep 1; done
graph/bin/jammkle unjam
graph/bin/jammkle jam --vacuum-kpa 40 # all, as the controller may hold some at another vacuum
kill -INT "$up"
wait "$up"
echo "with the extra ros: the graph works"
