#!/bin/sh
# SPDX-License-Identifier: MIT
# Goal: without io_uring, lockable memory, huge pages and a descriptor store the status names each loss
# with what to do.  (That all works all the same, the tests say that run so: tests/systemd.cmake.)
#
#	degraded.sh TESTS   the folder of the test programs
set -eu

tests=$1
folder=$(mktemp -d)
daemon=
finish() {
	[ -z "$daemon" ] || kill "$daemon" 2>/dev/null || true
	rm -rf "$folder"
}
trap finish EXIT

"$OOCD_BIN/oocgen" plant --triangles 200000 --seed 1 -o "$folder/plant.ply"
"$OOCD_BIN/oocbuild" --quiet -o "$folder/plant.ooc" "$folder/plant.ply"
"$tests/without" "$OOCD_BIN/oocd" --socket "$folder/oocd.sock" --cache-size 256M "$folder/plant.ooc" \
	2>"$folder/log" &
daemon=$!
tries=0
until [ -S "$folder/oocd.sock" ]; do
	tries=$((tries + 1))
	[ "$tries" -le 400 ] || { cat "$folder/log"; exit 1; }
	sleep 0.05
done
# The first segment is made before anyone asks for it, but not before the socket is there.
tries=0
until "$OOCD_BIN/oocctl" status --socket "$folder/oocd.sock" >"$folder/status" &&
	grep -q 'degraded: huge pages' "$folder/status"; do
	tries=$((tries + 1))
	[ "$tries" -le 400 ] || { echo "huge pages are not named:"; cat "$folder/status"; exit 1; }
	sleep 0.05
done
for loss in 'io_uring' 'descriptor store'; do
	grep -q "degraded: .*$loss" "$folder/status" || {
		echo "not named: $loss"
		cat "$folder/status"
		exit 1
	}
done
kill "$daemon"
wait "$daemon" || { echo "oocd failed"; cat "$folder/log"; exit 1; }
daemon=
