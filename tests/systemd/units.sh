#!/bin/bash
# SPDX-License-Identifier: MIT
# Goal: the units work as they are installed, with exactly their options: activation, readiness, reload,
# a cache that outlives restart, crash and watchdog, users that are told apart.
# Method: `cmake --install` into a layer over this machine's root; a systemd of its own boots there.
#
#	units.sh BUILD PREFIX   where the build is, and what it was configured to be installed in
set -eu

build=$1
prefix=$2
here=$(dirname "$0")
folder=$(mktemp -d)
box=$folder/box
layer=$folder/layer
config=$prefix/etc/oocd/oocd.conf
[ "$prefix" != /usr ] || config=/etc/oocd/oocd.conf
booted=
finish() {
	status=$?
	if [ -n "$booted" ]; then
		[ "$status" -eq 0 ] || inside journalctl -u oocd --no-pager -n 30 || true
		"$here/box" stop "$box"
	fi
	rm -rf "$folder"
}
trap finish EXIT

inside() {
	"$here/box" exec "$box" "$@"
}
oocctl() {
	inside "$prefix/bin/oocctl" "$@"
}
as() {
	local uid=$1
	shift
	inside setpriv --reuid "$uid" --regid "$uid" --clear-groups "$prefix/bin/oocctl" "$@"
}
fail() {
	echo "units: $*"
	exit 1
}
expect() {
	[ "$1" = "$2" ] || fail "$3: not $2 but $1"
}
# The sum of the numbers of that name in the daemon's status, as an administrator sees it.
number() {
	oocctl status --json | awk -v key="\"$1\":" '$1 == key { sum += $2 } END { print sum + 0 }'
}
property() {
	inside systemctl show oocd.service --value -p "$1"
}
# await VALUE COMMAND...: until the command says it.
await() {
	local want=$1
	shift
	for _ in $(seq 500); do
		[ "$("$@" 2>/dev/null || true)" != "$want" ] || return 0
		sleep .02
	done
	fail "$* does not come to $want"
}
configure() {
	printf '%s\n' "$@" | inside tee "$config" >/dev/null
}

# All of a store in memory; no node's read is repeated after this.
fill() {
	oocctl nodes /srv/open.ooc | awk '$1 ~ /^[0-9]+$/ { print $1 }' |
		oocctl prefetch /srv/open.ooc --nodes - >/dev/null
	ready=$(number ready_nodes)
	[ "$ready" -gt 0 ] || fail "nothing is in memory"
}
# The daemon is another one, and has what the one before had.
check_warm() {
	await active property ActiveState
	pid=$(property MainPID)
	[ "$pid" != "$before" ] || fail "$1: it is the same daemon"
	await 0 number takeover_left
	expect "$(number takeover_verified)" "$ready" "$1: payloads that were verified"
	expect "$(number ready_nodes)" "$ready" "$1: nodes in memory"
	expect "$(number read_bytes)" 0 "$1: bytes read"
	before=$pid
}

# ---- as installed ----

mkdir -p "$layer/srv" "$box"
DESTDIR=$layer cmake --install "$build" >"$folder/install.log" || {
	cat "$folder/install.log"
	exit 1
}
[ -s "$layer$config" ] || fail "no configuration is installed"
echo "# mine" >"$layer$config"
DESTDIR=$layer cmake --install "$build" >"$folder/install.log"
expect "$(cat "$layer$config")" "# mine" "a configuration that was there"
"$build/bin/oocgen" plant --triangles 40000 --seed 1 -o "$folder/plant.ply"
"$build/bin/oocbuild" --quiet --leaf-triangles 500 -o "$layer/srv/open.ooc" "$folder/plant.ply"
install -m 0640 "$layer/srv/open.ooc" "$layer/srv/closed.ooc"
chown 0:20003 "$layer/srv/closed.ooc"
chmod 0644 "$layer/srv/open.ooc"
status=0
"$here/box" start "$box" "$layer" || status=$?
[ "$status" -eq 0 ] || exit "$status"
booted=yes

report=$(inside systemd-analyze verify --man=no oocd.service oocd.socket 2>&1 | grep oocd || true)
[ -z "$report" ] || fail "systemd-analyze verify: $report"
report=$(inside systemd-analyze verify --man=no --user "$prefix/lib/systemd/user/oocd.service" \
	"$prefix/lib/systemd/user/oocd.socket" 2>&1 | grep oocd || true)
[ -z "$report" ] || fail "systemd-analyze verify --user: $report"
inside systemd-analyze security --offline=true --threshold=6 "$prefix/lib/systemd/system/oocd.service" \
	>"$folder/security" || fail "exposure: $(tail -n 1 "$folder/security")"

# ---- activation ----

inside ldconfig
inside systemd-sysusers
inside systemd-tmpfiles --create oocd.conf
configure "cache-size = 64M" "grace = 0"
inside systemctl start oocd.socket
expect "$(property ActiveState)" inactive "before the first client"
fill
expect "$(property ActiveState)" active "after the first client"
before=$(property MainPID)
expect "$(inside stat -c %U "/proc/$before")" oocd "the daemon's user"
expect "$(number cache_bytes)" $((64 << 20)) "the configured cache"
degraded=$(oocctl status | grep '^degraded' | grep -v 'huge pages' || true)
[ -z "$degraded" ] || fail "$degraded"
await 1 sh -c "'$here/box' exec '$box' systemctl show oocd.service -p StatusText | grep -c 'of 64.0 MiB'"

# ---- users ----

for uid in 20001 20002 20003; do
	as $uid nodes /srv/open.ooc >/dev/null || fail "user $uid cannot see what all may read"
done
as 20003 nodes /srv/closed.ooc >/dev/null || fail "the group of a store cannot see it"
for uid in 20001 20002; do
	! as $uid nodes /srv/closed.ooc >"$folder/denied" 2>&1 || fail "user $uid sees what it may not read"
	! as $uid status --json | grep -q closed.ooc || fail "user $uid is told of what it may not read"
	! as $uid reload 2>/dev/null || fail "user $uid may reload"
done
for uid in 20001 20002 20003; do
	oocctl status --json | grep -q "\"uid\": $uid" || fail "user $uid has no account of its own"
done

# ---- journal ----

size=$(stat -c %s "$layer/srv/open.ooc")
inside cp /srv/open.ooc /srv/damaged.ooc
printf 'damage' | inside dd of=/srv/damaged.ooc bs=1 seek=$((size / 2)) conv=notrunc status=none
inside chmod 0644 /srv/damaged.ooc
oocctl nodes /srv/damaged.ooc | awk '$1 ~ /^[0-9]+$/ { print $1 }' |
	oocctl prefetch /srv/damaged.ooc --nodes - --deadline 1 >/dev/null 2>&1 || true
await 1 sh -c "'$here/box' exec '$box' journalctl -u oocd -o cat OOCD_STORE=/srv/damaged.ooc --no-pager |
	grep -c 'damaged: its checksum is wrong'"
ready=$(number ready_nodes)

# ---- reload ----

configure "cache-size = 96M" "grace = 0"
inside systemctl reload oocd || fail "a right configuration is not taken over"
expect "$(number cache_bytes)" $((96 << 20)) "the cache after a reload"
configure "cache-size = 96M" "io = tape"
! inside systemctl reload oocd 2>/dev/null || fail "a wrong configuration is taken over"
inside journalctl -u oocd --no-pager -o cat | grep -q "oocd.conf:2: io = tape: not uring, pread or auto" ||
	fail "the journal does not say what is wrong"
expect "$(property MainPID)" "$before" "the daemon after reloads"
configure "cache-size = 96M" "grace = 0"

# ---- what outlives it ----

inside systemctl restart oocd
check_warm "restart"
inside kill -KILL "$before"
await 1 property NRestarts
check_warm "kill"
inside mkdir -p /run/systemd/system/oocd.service.d
printf '%s\n' '[Service]' 'WatchdogSec=1' 'TimeoutAbortSec=100ms' |
	inside tee /run/systemd/system/oocd.service.d/soon.conf >/dev/null
inside systemctl daemon-reload
inside systemctl restart oocd
check_warm "restart with a short watchdog"
inside kill -STOP "$before"
await watchdog property Result
await active property ActiveState
check_warm "watchdog"

inside systemctl stop oocd.service oocd.socket
expect "$(property Result)" success "the end"
expect "$(property NFileDescriptorStore)" 0 "descriptors that are kept after the end"
