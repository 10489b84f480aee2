#!/bin/bash
# The Debian package under a real systemd: service_check.sh PACKAGE.deb CASE
#   CASE   a case folder with recording.mcap, rig.toml and scans/ (`gnathion demo` makes one)
# A systemd is booted in namespaces of its own, over a copy-on-write view of this machine's files: nothing here is
# changed. Needs root. Each line that is printed is one check; the first that fails ends it with 1.
set -u
deb=$(realpath "$1"); case_folder=$(realpath "$2"); here=$(dirname "$(realpath "$0")")
[ "$(id -u)" = 0 ] || { echo "service_check: needs root, for the namespaces" >&2; exit 2; }

if [ "${3:-}" != inside ]; then
  base=$(mktemp -d); mount -t tmpfs -o size=6G tmpfs "$base"
  trap exit INT TERM HUP
  trap 'kill -9 "$systemd" 2>/dev/null; wait 2>/dev/null; umount -R -l "$base"; rmdir "$base"' EXIT
  mkdir "$base"/{upper,work,root}
  setsid unshare --mount --pid --uts --ipc --net --fork --kill-child "$0" "$deb" "$case_folder" inside "$base" > "$base/console" 2>&1 &
  systemd=$!
  enter() { nsenter -t "$(pgrep -P "$systemd" | head -1)" -m -p -u -i -n -- env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root TERM=dumb "$@"; }
  for _ in $(seq 60); do enter systemctl is-system-running 2>/dev/null | grep -qE 'running|degraded' && break; sleep 1; done
  enter systemctl is-system-running 2>/dev/null | grep -qE 'running|degraded' || { echo "systemd did not come up:"; tail -20 "$base/console"; exit 1; }
  enter bash /var/check/service_steps.sh
  exit
fi

# Inside: a root of its own, then systemd as its first process.
set -e
base=$4; root=$base/root
mount -t overlay overlay -o "lowerdir=/,upperdir=$base/upper,workdir=$base/work" "$root"
for folder in run tmp; do mount -t tmpfs tmpfs "$root/$folder"; done
mount --rbind /dev "$root/dev"; mount -t sysfs sysfs "$root/sys"; mount -t tmpfs tmpfs "$root/sys/fs/cgroup"
if [ "$(stat -fc %T /sys/fs/cgroup)" = cgroup2fs ]; then
  umount "$root/sys/fs/cgroup"; mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup"
else
  mkdir "$root"/sys/fs/cgroup/{systemd,unified,devices,pids,memory}
  mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup/unified"
  mount -t cgroup -o none,name=systemd cgroup "$root/sys/fs/cgroup/systemd"
  for name in devices pids memory; do mount -t cgroup -o "$name" cgroup "$root/sys/fs/cgroup/$name"; done
fi
rm -f "$root/etc/fstab" "$root/usr/sbin/policy-rc.d"; tr -d - < /proc/sys/kernel/random/uuid > "$root/etc/machine-id"
mkdir -p "$root/var/check" "$root/outside"
cp "$deb" "$root/var/check/gnathion.deb"; cp -r "$case_folder" "$root/var/check/case"; cp "$here/service_steps.sh" "$root/var/check/"
cd "$root"; pivot_root . outside; mount -t proc proc /proc; umount -l /outside
export container=lxc
exec /lib/systemd/systemd --system --unit=multi-user.target --log-target=journal
