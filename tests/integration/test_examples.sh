#!/bin/sh
# SPDX-License-Identifier: MIT
# The library as somebody else's program finds it: installed below a prefix, found by pkg-config.
# Both examples are built against that and run on a store, with a daemon that they start themselves.
#
#	test_examples.sh BUILD_FOLDER SOURCE_FOLDER STORE_MAKER CC CXX [FLAGS]
set -eu
build=$1 source=$2 store_maker=$3 cc=$4 cxx=$5 flags=${6:-}
folder=$(mktemp -d)
daemon=
finish() {
	[ -z "$daemon" ] || kill "$daemon" 2>/dev/null || true
	rm -rf "$folder"
}
trap finish EXIT
fail() {
	echo "test_examples: $*" >&2
	exit 1
}

cmake --install "$build/libclient" --prefix "$folder/usr" >"$folder/install.log" || fail "$(cat "$folder/install.log")"
pc=$(find "$folder/usr" -name oocclient.pc)
[ -n "$pc" ] || fail "no oocclient.pc is installed"
PKG_CONFIG_PATH=$(dirname "$pc")
export PKG_CONFIG_PATH
# Nothing of the source tree may be needed.
cflags=$(pkg-config --cflags oocclient)
libs=$(pkg-config --libs oocclient)
LD_LIBRARY_PATH=$(pkg-config --variable=libdir oocclient)
export LD_LIBRARY_PATH
cd "$folder"
cp "$source"/libclient/examples/ooc_list.c "$source"/libclient/examples/ooc_stream.cpp .
$cc -std=c11 -Wall -Wextra -Werror $flags ooc_list.c $cflags $libs -o ooc_list
$cxx -std=c++17 -Wall -Wextra -Werror $flags ooc_stream.cpp $cflags $libs -o ooc_stream

"$store_maker" "$folder/model.ooc"
export OOCD_SOCKET="$folder/sock" OOCD_DAEMON="$build/bin/oocd"

# The scene is 8 x 8 x 8 boxes of 12 triangles, in 4 parts.
./ooc_list model.ooc >all.txt
daemon=$(pgrep -f "oocd --socket $folder/sock" | head -n 1)
[ -n "$daemon" ] || fail "no daemon runs after ooc_list"
[ "$(wc -l <all.txt)" = 4 ] || fail "ooc_list names $(wc -l <all.txt) parts of 4"
[ "$(awk '{ n += $3 } END { print n }' all.txt)" = 6144 ] || fail "ooc_list: $(cat all.txt)"
./ooc_list model.ooc 0 0 0 0.9 0.9 0.9 >some.txt
[ "$(awk '{ n += $3 } END { print n }' some.txt)" = 96 ] || fail "ooc_list in a box: $(cat some.txt)"
./ooc_stream model.ooc 16 | grep -q '^6144 triangles in 64 nodes, .* 1 portions$' ||
	fail "ooc_stream: $(./ooc_stream model.ooc 16)"
./ooc_stream model.ooc 0 | grep -q '^6144 triangles in 64 nodes, .* 64 portions$' ||
	fail "ooc_stream in single nodes: $(./ooc_stream model.ooc 0)"

# Bad input: one line, and exit 1; wrong usage: 2.
! ./ooc_list nothing.ooc 2>error.txt || fail "ooc_list finds what is not there"
grep -q '^ooc_list: nothing.ooc: cannot be opened: No such file' error.txt || fail "$(cat error.txt)"
echo text >text.ooc
! ./ooc_stream text.ooc 2>error.txt || fail "ooc_stream opens a text file"
[ "$(wc -l <error.txt)" = 1 ] || fail "$(cat error.txt)"
status=0
./ooc_list 2>/dev/null || status=$?
[ "$status" = 2 ] || fail "ooc_list without arguments exits $status"
