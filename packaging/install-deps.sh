#!/usr/bin/env bash
# Installs what packaging/apt-packages.txt names and the machine lacks; says first what it will install.
set -euo pipefail
list="$(dirname "$0")/apt-packages.txt"
missing=()
for package in $(sed 's/#.*//' "$list"); do
  # Node.js may come from elsewhere with an npm of its own, which Debian's package would break.
  case "$package" in nodejs | npm) command -v "${package%js}" >/dev/null && continue ;; esac
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
done
[ ${#missing[@]} -eq 0 ] && exit 0
as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null || { echo "gnathion: cannot install: ${missing[*]}: neither root nor sudo" >&2; exit 1; }
  as_root=(sudo)
fi
echo "These Debian packages will be installed${as_root:+ (with sudo)}: ${missing[*]}"
"${as_root[@]}" apt-get update -qq
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
