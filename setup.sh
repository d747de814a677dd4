#!/usr/bin/env bash
# Install what the product and its tests need: system packages, then a virtual environment from the lock file.
# Run by `make setup`; a second run finds everything in place and takes seconds.
set -euo pipefail
cd "$(dirname "$0")"
venv=${1:-.venv}

# Offscreen OpenGL for the videos, what Open3D is linked to (libgl1, libidn2, libusb), numba's threads (libgomp1), a
# browser and what drives it (libatomic1) for the browser tests, fonts for plots.
# "a|b" means: a, or b where the distribution has no a. "?a" means: a, where the distribution has it.
packages=(libegl1 libgl1-mesa-dri libgl1 libgomp1 libidn2-0 libusb-1.0-0 "?libosmesa6" "chromium|chromium-browser" libatomic1 fonts-dejavu-core ${TEST_PACKAGES:-})

installed() { dpkg-query -W -f='${Status}' "$1" 2>/dev/null | grep -q 'ok installed'; }
known() { [ -n "$(apt-cache madison "$1" 2>/dev/null)" ]; }

missing_packages() {
  local entry name first
  for entry in "${packages[@]}"; do
    first=""
    for name in $(echo "${entry#\?}" | tr '|' ' '); do
      if installed "$name"; then first="-"; break; fi
      if [ -z "$first" ] && known "$name"; then first=$name; fi
    done
    if [ "$first" = "-" ]; then continue; fi
    if [ -n "$first" ]; then echo "$first"
    elif [ "${entry#\?}" = "$entry" ]; then echo "${entry%%|*}"; fi
  done
}

install_system_packages() {
  if ! command -v dpkg-query >/dev/null; then
    echo "setup: not Debian or Ubuntu; going on, but videos need EGL or OSMesa and the browser tests need Chromium." >&2
    return
  fi
  local missing root=()
  mapfile -t missing < <(missing_packages)
  [ ${#missing[@]} -gt 0 ] || return 0
  if [ "$(id -u)" -ne 0 ]; then root=(sudo); fi
  if [ "$(id -u)" -ne 0 ] && ! command -v sudo >/dev/null; then
    echo "setup: these system packages are missing and need root: ${missing[*]}" >&2
    echo "setup: as root, run: apt-get install ${missing[*]}    then run this again." >&2
    exit 1
  fi
  "${root[@]}" apt-get update -qq
  mapfile -t missing < <(missing_packages)
  echo "setup: installing system packages: ${missing[*]}"
  "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null || {
    echo "setup: could not install ${missing[*]}; install them by hand, then run this again." >&2
    exit 1
  }
}

find_python() {
  local name
  for name in python3.11 python3.12 python3.13 python3; do
    if command -v "$name" >/dev/null && "$name" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
      echo "$name"
      return
    fi
  done
  echo "setup: no Python 3.11 or newer with venv found; on Debian or Ubuntu: apt-get install python3 python3-venv" >&2
  exit 1
}

# Say how far pip is, from what it prints; a line for every tenth package. Argument: how many there are.
tell_of_packages() {
  local line n=0
  while read -r line; do
    case $line in
      "Collecting "* | "Processing "*) n=$((n + 1)); [ $((n % 10)) -ne 0 ] || echo "setup: $n of at most $1 packages fetched" ;;
      "Installing collected"*) echo "setup: $n packages fetched; unpacking them" ;;
    esac
  done
}

install_python_packages() {
  local wanted total
  wanted=$({ pwd; cat requirements.lock pyproject.toml setup.py setup.sh; } | sha256sum | cut -d' ' -f1)
  if [ "$(cat "$venv/.installed" 2>/dev/null)" = "$wanted" ]; then return; fi
  local python
  python=$(find_python)
  echo "setup: installing Python packages into $venv (a few minutes the first time)"
  [ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
  total=$(grep -c '^[A-Za-z0-9].*==' requirements.lock)
  PYTHONUNBUFFERED=1 "$venv/bin/python" -m pip install --progress-bar off --disable-pip-version-check --no-compile \
    --require-hashes -r requirements.lock | tell_of_packages "$total"
  echo "setup: compiling their modules"
  PYTHONWARNINGS=ignore "$venv/bin/python" -m compileall -qq -j 0 "$venv/lib" || true  # on all cores, which pip does on one
  "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
  echo "$wanted" > "$venv/.installed"
}

# Packages by npm out of the virtual environment: browser code of the experimenter's pages, and the TypeScript that checks
# all browser code. Without them everything works but live updates, interactive figures, the 3D view and that check, so a
# machine that cannot reach npm's registry is set up all the same.
install_browser_packages() {
  local unreachable=$venv/.npm-unreachable  # for the test of the wheel, which needs them
  rm -f "$unreachable"
  frontend/vendor.sh "$venv/bin/python" || {
    echo "setup: npm could not install the browser packages (see above; its registry must be reachable)." >&2
    echo "setup: going on without: pages do not update by themselves and have no 3D view, and \`make check\` fails at the" >&2
    echo "setup: types of browser code, until you run this again." >&2
    touch "$unreachable"
  }
}

check_browser() {
  local name
  for name in chromium chromium-browser google-chrome; do
    if "$name" --version >/dev/null 2>&1; then return; fi
  done
  echo "setup: no Chromium runs here (Ubuntu's is a snap, which containers have not); going on, but browser tests will be" >&2
  echo "setup: skipped, until \`snap install chromium\` or an installed Google Chrome." >&2
}

# Say which packages of the tests this distribution has not, or that cannot be known here.
tell_left_out() {
  local entry
  for entry in ${TEST_PACKAGES:-}; do
    if command -v dpkg-query >/dev/null && installed "${entry#\?}"; then continue; fi
    echo "setup: ${entry#\?} is not a package here; tests that need it are left out, and pytest says which."
  done
}

# Say at the end of a set-up that had something to do how long it took, and what comes next.
tell_done() {
  echo "setup: done after $((SECONDS / 60)) min $((SECONDS % 60)) s; to use it: . $venv/bin/activate, then reconstudy --help"
}

before=$(cat "$venv/.installed" 2>/dev/null || true)
install_system_packages
tell_left_out
install_python_packages
install_browser_packages
check_browser
[ -z "${COMPILED:-}" ] || make --no-print-directory --silent "$COMPILED"  # kernels, so that no command waits for them
[ "$before" = "$(cat "$venv/.installed")" ] || tell_done
