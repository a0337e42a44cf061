#!/usr/bin/env bash
# Sets everything up and runs all tests: fast ones, slow ones, then ROS 2 and the reference oracle in environments of their own.
set -euo pipefail
cd "$(dirname "$0")"

# --wire: also the fault tests of the ROS 2 and Franka drivers against their peers. They take minutes more and need a quiet machine.
wire=0
[ "${1:-}" != --wire ] || { wire=1; shift; }

./setup.sh test realsense franka export train viewer

# What tests need of the system: a browser for the view, and compilers for the ROS 2 interfaces.
missing=()
command -v chromium chromium-browser google-chrome >/dev/null || missing+=(chromium)
for pair in cmake:cmake ninja:ninja-build c++:g++; do command -v "${pair%%:*}" >/dev/null || missing+=("${pair##*:}"); done
if [ ${#missing[@]} -gt 0 ]; then
  root=(); [ "$(id -u)" = 0 ] || root=(sudo -n)
  echo "[test] installing Debian packages: ${missing[*]}"
  "${root[@]}" apt-get update -qq && "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null || {
    echo "Run:  sudo apt-get install ${missing[*]}   and start this command again." >&2
    exit 1
  }
fi

# franka-sim speaks the robot's network protocol strictly; it needs numpy 1, the application numpy 2.
if [ ! -f .venv-franka-sim/evg-setup ] || ! cmp -s pyproject.toml .venv-franka-sim/evg-setup; then
  .venv/bin/python -m venv --clear .venv-franka-sim
  .venv-franka-sim/bin/pip install -q --upgrade "pip>=25.1"
  .venv-franka-sim/bin/pip install -q --group franka-sim
  cp pyproject.toml .venv-franka-sim/evg-setup
fi

export OMP_NUM_THREADS=1 OMP_WAIT_POLICY=passive
.venv/bin/python -m pytest -m "not slow and not oracle and not ros" "$@"
slow=()
[ $wire = 1 ] || slow=(--ignore=tests/robots/fci --ignore=tests/cli/test_run_hardware.py)
.venv/bin/python -m pytest -m "slow and not oracle and not ros" "${slow[@]}" "$@"

# ROS wheels restart every Python of their environment, so they get one of their own, on top of .venv.
if [ ! -f .venv-ros/evg-setup ] || ! cmp -s pyproject.toml .venv-ros/evg-setup; then
  .venv/bin/python -m venv --clear .venv-ros
  site() { "$1" -c 'import sysconfig; print(sysconfig.get_path("purelib"))'; }
  echo "import site; site.addsitedir('$(site .venv/bin/python)')" > "$(site .venv-ros/bin/python)/evg-core.pth"
  .venv-ros/bin/pip install -q --upgrade "pip>=25.1"
  .venv-ros/bin/pip install -q -c constraints.txt -e ".[ros]"
  cp pyproject.toml .venv-ros/evg-setup
fi
.venv-ros/bin/evg-app ros build
ros=(tests/contract tests/robots/ros2/test_survey.py)
[ $wire = 0 ] || ros=(tests/contract tests/robots/ros2)
.venv-ros/bin/python -m pytest -m ros "${ros[@]}" "$@"

# escnn needs numpy 1, the application numpy 2.
if [ ! -f .venv-escnn/evg-setup ] || ! cmp -s pyproject.toml .venv-escnn/evg-setup; then
  .venv/bin/python -m venv --clear .venv-escnn
  .venv-escnn/bin/pip install -q --upgrade "pip>=25.1"
  .venv-escnn/bin/pip install -q "torch==2.13.0+cpu" "numpy==1.26.4" 2>/dev/null || {
    .venv-escnn/bin/pip install -q uv
    .venv-escnn/bin/uv pip install -q --python .venv-escnn/bin/python --torch-backend cpu "torch==2.13.0" "numpy==1.26.4"
  }
  .venv-escnn/bin/pip install -q --group escnn
  .venv-escnn/bin/pip install -q --no-deps escnn==1.0.11
  cp pyproject.toml .venv-escnn/evg-setup
fi
.venv-escnn/bin/python -m pytest -m oracle tests/oracle "$@"
