#!/bin/bash
# What service_check.sh does inside: the package and its service, as an administrator and a user meet them.
set -u
deb=/var/check/gnathion.deb
good() { echo "good: $*"; }
bad() { echo "BAD:  $*"; systemctl status gnathiond --no-pager -l | tail -30; journalctl -u gnathiond --no-pager | tail -30; exit 1; }
expect() { local what=$1; shift; if "$@" > /tmp/out 2>&1; then good "$what"; else cat /tmp/out; bad "$what"; fi; }
refused() { local what=$1; shift; if "$@" > /tmp/out 2>&1; then bad "$what"; else good "$what: $(head -1 /tmp/out)"; fi; }
until_true() { for _ in $(seq "$1"); do "${@:2}" > /tmp/out 2>&1 && return 0; sleep 1; done; return 1; }
says() { local text=$1; shift; "$@" 2>&1 | grep -q -- "$text"; }
main_pid() { systemctl show -p MainPID --value gnathiond; }
active() { [ "$(systemctl is-active gnathiond)" = active ] && gnathion devices list; }
recording() { says '"state": *"recording"' gnathion capture state --json; }
upgraded() {  # upgraded VERSION: the same package with a higher version
  rm -rf /tmp/again && dpkg-deb -R $deb /tmp/again && sed -i "s/^Version: .*/Version: $1/" /tmp/again/DEBIAN/control && dpkg-deb -b /tmp/again /tmp/again.deb
}
start_recording() { gnathion capture arm "$1" && gnathion capture start; }
newest() { ls -t /var/lib/gnathion/cases/p-001/recordings/*.mcap | head -1; }

# 1. Installing
expect "installs" dpkg -i $deb
expect "runs, and tells systemd when it is ready (Type=notify)" until_true 20 active
[ "$(stat -c '%a %G' /run/gnathion/gnathiond.sock)" = "660 gnathion" ] || bad "the socket's mode and group"
[ "$(stat -c '%a %U' /var/lib/gnathion/cases)" = "700 gnathion" ] || bad "the case root's mode and owner"
good "socket 0660 of gnathion, cases 0700"

# 2. Users
useradd -m anna; useradd -m eve; adduser --quiet anna gnathion
refused "a user outside the group gets nothing" su eve -c 'gnathion devices list'
expect "a user of the group is served" su anna -c 'gnathion devices list'
expect "the audit trail names her" grep -q '(anna)' <(su anna -c 'gnathion cases create p-001'; gnathion audit show)

# 3. Work in the sandbox: a case through the socket, a job that draws pictures
cp -r /var/check/case/scans /home/anna/scans; chown -R anna /home/anna
expect "a case comes in through the socket" su anna -c 'gnathion cases import /home/anna/scans p-002'
T=/var/lib/gnathion/cases/p-002
install -o gnathion -g gnathion -m 600 /var/check/case/results/T_th.json $T/t.json
maxilla=$(cd $T && find . -name 'maxilla*' -path '*scans*' | sed 's|^\./||' | grep -v _tp | head -1); mandible=$(cd $T && find . -name 'mandible*' -path '*scans*' | sed 's|^\./||' | grep -v -e _tp -e clutch | head -1)
expect "a design with pictures runs in the sandbox ($maxilla, $mandible)" \
  su anna -c "gnathion jobs submit p-002 design maxilla=$maxilla mandible=$mandible transform=t.json set=design.voxel_mm=0.25 out=results/splint --wait"
pictures=$(find $T/results/splint -name '*.png' | wc -l)
[ -s $T/results/splint/splint.stl ] && [ "$pictures" -gt 3 ] || bad "splint.stl and pictures of the design"
good "splint.stl and $pictures pictures"

# 4. Recording: reload, stop
cp /var/check/case/recording.mcap /var/lib/gnathion/cases/p-002/source.mcap; cp /var/check/case/rig.toml /etc/gnathion/; chown gnathion: /var/lib/gnathion/cases/p-002/source.mcap
printf '[[device]]\nname = "replay"\nkind = "replay"\npath = "/var/lib/gnathion/cases/p-002/source.mcap"\n' > /tmp/devices.toml
expect "devices are configured" gnathion devices configure /tmp/devices.toml
expect "recording begins" start_recording p-001
sleep 3; pid=$(main_pid)
expect "reload" systemctl reload gnathiond
sleep 2; recording && [ "$(main_pid)" = "$pid" ] || bad "the recording goes on over a reload"
good "the recording goes on over a reload"
expect "stop while recording" systemctl stop gnathiond
expect "the recording is whole" gnathion recording verify "$(newest)"
expect "and in case.toml" grep -q "recordings/" /var/lib/gnathion/cases/p-001/case.toml
expect "start" systemctl start gnathiond

# 5. Killed, and hung
until_true 20 active; start_recording p-001 > /dev/null; sleep 3; pid=$(main_pid); kill -9 "$pid"
expect "kill -9 while recording: up again by itself" until_true 20 active
[ "$(main_pid)" != "$pid" ] || bad "a new process"
expect "its recording is made whole" gnathion recording verify "$(newest)"
start_recording p-001 > /dev/null; sleep 2; pid=$(main_pid); begun=$(date +%s); kill -STOP "$pid"
expect "hung: the watchdog ends it" until_true 60 says "Watchdog timeout" journalctl -u gnathiond --no-pager
expect "and it is up again" until_true 60 active
good "$(( $(date +%s) - begun )) s from the hang to a daemon that serves"
expect "its recording is made whole" gnathion recording verify "$(newest)"

# 6. Upgrading
start_recording p-001 > /dev/null; sleep 3; upgraded 99.1
expect "upgrade while recording" dpkg -i /tmp/again.deb
expect "the new version serves" until_true 20 active
expect "the recording that ran is whole" gnathion recording verify "$(newest)"
expect "an administrator disables it" systemctl disable --now gnathiond
upgraded 99.2; expect "upgrade" dpkg -i /tmp/again.deb
[ "$(systemctl is-enabled gnathiond)" = disabled ] || bad "stays disabled over an upgrade"
[ "$(systemctl is-active gnathiond)" = inactive ] || bad "stays stopped over an upgrade"
good "stays disabled and stopped over an upgrade"
expect "enable again" systemctl enable --now gnathiond

# 7. A configuration with a fault
echo 'prot = 1' >> /etc/gnathion/gnathiond.toml
systemctl reload gnathiond; sleep 1; active > /dev/null || bad "a reload with a fault leaves it serving"
expect "the fault is in the journal by name" until_true 10 says "prot" journalctl -u gnathiond --no-pager
sed -i '/^prot = 1/d' /etc/gnathion/gnathiond.toml

# 8. Removing, installing again, purging
expect "removes" dpkg -r gnathion
[ ! -e /usr/bin/gnathiond ] && [ ! -e /run/gnathion/gnathiond.sock ] && ! pgrep -x gnathiond > /dev/null || bad "program, socket and process are gone"
[ -e /etc/gnathion/gnathiond.toml ] && [ -e /var/lib/gnathion/cases/p-001/case.toml ] || bad "configuration and cases stay"
good "program, socket and process are gone; configuration and cases stay"
expect "installs again" dpkg -i $deb
until_true 20 active; expect "with the cases of before" says p-001 gnathion cases list
expect "the audit trail holds over all that" gnathion audit verify /var/lib/gnathion/audit.jsonl
expect "purges" dpkg -P gnathion
[ ! -e /etc/gnathion/gnathiond.toml ] && [ -e /var/lib/gnathion/cases/p-001/case.toml ] && [ ! -e /var/lib/gnathion/catalogue.sqlite ] || bad "configuration and catalogue gone, cases kept"
good "configuration and catalogue gone, cases kept"
echo "all good"
