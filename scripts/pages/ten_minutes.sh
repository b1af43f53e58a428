#!/usr/bin/env bash
# The first ten minutes of a new user, in a fresh clone: install, paste the files of
# docs/own_robot.md, check them, print a torque, write a page. Leaves nothing behind.
set -euo pipefail
repository=$(cd "$(dirname "$0")/../.." && pwd)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
git clone --quiet "$repository" "$folder/clone"
cd "$folder/clone"
python3 -m venv .venv
.venv/bin/pip install --quiet '.[plot,viz]'
.venv/bin/python scripts/pages/run_pages.py --paste "$folder/mine" docs/own_robot.md
cd "$folder/mine"
"$folder/clone/.venv/bin/sst-pin" validate five_bar.urdf
"$folder/clone/.venv/bin/python" -I session.py | tee printed
grep '^at rest: .* N m$' printed
test -s five_bar.html
echo "done in $((SECONDS / 60)) min $((SECONDS % 60)) s"
