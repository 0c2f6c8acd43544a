#!/bin/sh
# SPDX-License-Identifier: MIT
# Goal: oocd serves on the socket that a service manager hands to it, and the units say what is so.
# Method: systemd-socket-activate plays the manager; systemd-analyze judges the units, with the
# program of this build in the place of the installed one.
set -eu

if ! command -v systemd-socket-activate >/dev/null; then
	echo "skipped: systemd-socket-activate is not installed"
	exit 77
fi
folder=$(mktemp -d)
manager=
finish() {
	[ -z "$manager" ] || kill "$manager" 2>/dev/null || true
	rm -rf "$folder"
}
trap finish EXIT

"$OOCD_BIN/oocgen" plant --triangles 10000 --seed 1 -o "$folder/plant.ply"
"$OOCD_BIN/oocbuild" --quiet -o "$folder/plant.ooc" "$folder/plant.ply"

# The manager replaces itself with oocd when the first client connects: same process.
systemd-socket-activate --seqpacket -l "$folder/oocd.sock" \
	"$OOCD_BIN/oocd" --cache-size 64M "$folder/plant.ooc" 2>"$folder/manager.log" &
manager=$!
tries=0
until [ -S "$folder/oocd.sock" ]; do
	tries=$((tries + 1))
	[ "$tries" -le 200 ] || { cat "$folder/manager.log"; exit 1; }
	sleep 0.05
done
"$OOCD_BIN/oocctl" status --socket "$folder/oocd.sock" | grep -q 'plant\.ooc' || {
	echo "status does not show the store"
	exit 1
}
kill -TERM "$manager"
status=0
wait "$manager" || status=$?
manager=
[ "$status" -eq 0 ] || { echo "oocd ended with $status"; cat "$folder/manager.log"; exit 1; }
[ -S "$folder/oocd.sock" ] || { echo "oocd removed a socket that is not its own"; exit 1; }

cp "$OOCD_SOURCE/systemd/user/oocd.socket" "$folder/"
sed "s|@CMAKE_INSTALL_FULL_BINDIR@|$OOCD_BIN|" "$OOCD_SOURCE/systemd/user/oocd.service.in" \
	>"$folder/oocd.service"
report=$(systemd-analyze verify --man=no "$folder/oocd.socket" "$folder/oocd.service" 2>&1 |
	grep "$folder\|oocd\." || true)
[ -z "$report" ] || { printf '%s\n' "$report"; exit 1; }
