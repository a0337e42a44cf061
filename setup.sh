#!/usr/bin/env bash
# Sets up .venv for evg-app. Idempotent: a second call returns at once.
#   ./setup.sh [--cuda] [EXTRA ...]      extras: test train realsense ros franka export viewer
set -euo pipefail
cd "$(dirname "$0")"

cuda=0
extras=()
for word in "$@"; do
  case "$word" in
    --cuda) cuda=1 ;;
    -*) echo "setup.sh: unknown option $word; usage: ./setup.sh [--cuda] [EXTRA ...]" >&2; exit 2 ;;
    *) extras+=("$word") ;;
  esac
done

say() { echo "[set-up] $*"; }
as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo -n "$@"; fi; }
may_install() { command -v apt-get >/dev/null && { [ "$(id -u)" = 0 ] || sudo -n true 2>/dev/null; }; }
apt_install() {
  say "installing Debian packages: $*"
  as_root apt-get update -qq && as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

# 1. Shared libraries that the wheels expect of the system.
system_libraries() {
  [ "$(uname -s)" = Linux ] || return 0
  local missing=() pair
  local cache; cache=$(PATH="$PATH:/sbin:/usr/sbin" ldconfig -p 2>/dev/null || true)
  for pair in libgomp.so.1:libgomp1 libusb-1.0.so.0:libusb-1.0-0 libEGL.so.1:libegl1 libGL.so.1:libgl1 libX11.so.6:libx11-6; do
    case "$cache" in *"${pair%%:*}"*) ;; *) missing+=("${pair##*:}") ;; esac
  done
  [ ${#missing[@]} -gt 0 ] || return 0
  if may_install; then
    apt_install "${missing[@]}"
  else
    echo "Missing system libraries: ${missing[*]}" >&2
    echo "Run:  sudo apt-get install ${missing[*]}   and start this command again." >&2
    exit 1
  fi
}

# 2. Python 3.11: found, or fetched by uv.
is_311() { "$1" -c 'import sys, venv, ensurepip; raise SystemExit(sys.version_info[:2] != (3, 11))' 2>/dev/null; }
find_python() {
  local candidate
  for candidate in "${EVG_PYTHON:-}" python3.11 python3 python "$HOME/.pyenv/versions/"3.11.*/bin/python; do
    [ -n "$candidate" ] && command -v "$candidate" >/dev/null && is_311 "$candidate" && { command -v "$candidate"; return 0; }
  done
  return 1
}
make_venv() {
  [ -x .venv/bin/python ] && is_311 .venv/bin/python && return 0
  local python
  if python=$(find_python); then
    say "creating .venv with $python"
    "$python" -m venv --clear .venv
    return 0
  fi
  if may_install && apt-cache show python3.11-venv >/dev/null 2>&1; then
    apt_install python3.11 python3.11-venv
    python3.11 -m venv --clear .venv
    return 0
  fi
  if command -v uv >/dev/null || { command -v python3 >/dev/null && python3 -m venv .venv-uv && .venv-uv/bin/pip install -q uv; }; then
    say "fetching Python 3.11 with uv"
    PATH="$PATH:$PWD/.venv-uv/bin" uv venv --seed --clear --python 3.11 .venv && return 0
  fi
  echo "No Python 3.11 found (3.12 and newer have no wheels for pybullet)." >&2
  echo "Install one:  Debian 12: sudo apt-get install python3.11 python3.11-venv;  elsewhere: pipx install uv && uv python install 3.11" >&2
  echo "or point to one:  EVG_PYTHON=/path/to/python3.11 $0" >&2
  exit 1
}

# 3. torch: the CPU build, unless --cuda. The default wheel of an x86-64 Linux is the CUDA build of several GB.
install_torch() {
  local version=2.13.0
  .venv/bin/python -c "import importlib.metadata as m; raise SystemExit(m.version('torch').split('+')[0] != '$version')" 2>/dev/null && return 0
  say "installing torch $version ($([ $cuda = 1 ] && echo CUDA || echo CPU) build)"
  if [ $cuda = 1 ] || [ "$(uname -s)-$(uname -m)" != Linux-x86_64 ]; then
    .venv/bin/pip install -q -c constraints.txt "torch==$version"
  elif ! .venv/bin/pip install -q "torch==$version+cpu" 2>/dev/null; then
    .venv/bin/pip install -q uv
    .venv/bin/uv pip install -q --python .venv/bin/python --torch-backend cpu "torch==$version"
  fi
}

joined=$(IFS=,; echo "${extras[*]:-}")
stamp="$(cat pyproject.toml constraints.txt setup.sh | cksum) cuda=$cuda"
if [ -x .venv/bin/evg-app ] && [ -f .venv/evg-setup ] && [ "$(head -n1 .venv/evg-setup)" = "$stamp" ]; then
  done_extras=",$(tail -n1 .venv/evg-setup),"
  fresh=1
  for extra in "${extras[@]:-}"; do case "$done_extras" in *",$extra,"*) ;; *) [ -z "$extra" ] || fresh=0 ;; esac; done
  [ $fresh = 0 ] || exit 0
  joined="$(tail -n1 .venv/evg-setup)${joined:+,$joined}"
fi
system_libraries
make_venv
say "this downloads about 0.7 GB the first time and takes a few minutes"
.venv/bin/pip install -q --upgrade "pip>=25.1"
install_torch
say "installing evg-app${joined:+ [$joined]}"
.venv/bin/pip install -q -c constraints.txt -e ".${joined:+[$joined]}"
printf '%s\n%s\n' "$stamp" "$joined" > .venv/evg-setup
say "done: $(du -sh .venv | cut -f1) in .venv"
