#!/usr/bin/env bash
# Makes recordings of every kind and checks them with the official MCAP reader.
# Usage: official_reader.sh SAMPLES FULL_DISK_TEST GNATHION WORK_FOLDER
set -euo pipefail
samples=$1 full_disk=$2 gnathion=$3 work=$4
here=$(cd "$(dirname "$0")" && pwd)

mkdir -p "$work"
cp "$here/package.json" "$here/package-lock.json" "$here/check.mjs" "$work/"
if ! cmp -s "$here/package-lock.json" "$work/node_modules/.installed"; then
  if ! npm ping --prefix "$work" --fetch-retries=0 --fetch-timeout=20000 >/dev/null 2>&1; then
    echo "SKIPPED: npm cannot reach its registry, so the official reader is not here"
    exit 77
  fi
  npm ci --prefix "$work" --no-audit --no-fund --ignore-scripts --silent
  cp "$here/package-lock.json" "$work/node_modules/.installed"
fi

rm -rf "$work/recordings" && mkdir "$work/recordings"
"$samples" "$work/recordings"
GNATHION_KEEP_RECORDINGS=$work/recordings "$full_disk" >/dev/null
cd "$work"
node check.mjs "$gnathion" recordings/*.mcap
