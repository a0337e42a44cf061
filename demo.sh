#!/usr/bin/env bash
# Sets everything up and lets the simulated Panda clear a table. Arguments go to `evg-app run --sim`.
set -euo pipefail
cd "$(dirname "$0")"
./setup.sh
exec .venv/bin/evg-app run --sim "$@"
