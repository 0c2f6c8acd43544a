/* SPDX-License-Identifier: MIT */
/**
 * fetch.h - reads extents of files into memory, without blocking.
 *
 * A request is cut into pieces of at most FETCH_PIECE_BYTES, of which `depth` are in flight at one
 * time; requests are served in the order given.  Requests that follow each other in the file as they
 * do in that order share a piece, for a read costs the processor more than its bytes do; where such a
 * piece fails, each of them is read again by itself, so that no request fails for another's block.
 * A queue that was full is filled again when half of it is free, so that pieces go out together.
 * Short reads, EINTR and EAGAIN are not errors and are bounded.  It does not look at the bytes and
 * does not know what they are for.
 *
 * Three back ends do the reading: io_uring, threads with pread(2) where io_uring is denied, and a
 * simulated one for tests.  Around each a slower disk can be put (disk.h).
 *
 * Threads: loop thread.
 * Memory: fetch_create() takes all of it.
 */
#ifndef DAEMON_FETCH_FETCH_H
#define DAEMON_FETCH_FETCH_H

#include <stdbool.h>
#include <stdint.h>

#include "daemon/fetch/disk.h"
#include "formats/base/why.h"

struct fetch;

enum fetch_kind {
	FETCH_AUTO, /* io_uring, else pread */
	FETCH_URING,
	FETCH_PREAD,
	FETCH_SIM,
};

/** What the simulated back end does, in thousandths of the pieces, repeatably for a seed. */
struct fetch_sim {
	uint64_t seed;
	uint32_t short_permille;
	uint32_t interrupt_permille; /* EINTR */
	uint32_t error_permille;     /* EIO */
	uint32_t corrupt_permille;   /* one bit of what was read */
	uint32_t delay_permille;     /* comes back in a later round */
	uint32_t reorder;            /* 1: comes back in any order */
};

/** A request has ended.  error: 0, -EIO, -ENODATA (the file ends before), or another -errno. */
typedef void (*fetch_done_fn)(void *arg, uint64_t tag, int error);

struct fetch_config {
	enum fetch_kind kind;
	uint32_t depth; /* 1 .. FETCH_DEPTH_MAX */
	fetch_done_fn done;
	void *done_arg;
	struct fetch_sim sim;
	const struct disk_profile *disk; /* what is pretended to be read from; NULL: what it is */
};

/**
 * Returns: 0, or -errno with what to do about it where the back end asked for cannot be had.
 */
int fetch_create(const struct fetch_config *config, struct fetch **ret, struct why *why);

/** Waits for what is in flight, for it writes to memory; nobody is told.  NULL is allowed. */
struct fetch *fetch_destroy(struct fetch *fetch);

/** "uring", "pread" or "sim". */
const char *fetch_name(const struct fetch *fetch);

/** Why FETCH_AUTO did not take io_uring, and what to do; "" where it did. */
const char *fetch_degraded(const struct fetch *fetch);

/**
 * Makes a file known.  With O_DIRECT in its flags, requests go past the page cache.
 *
 * fd:  stays the caller's, and open until fetch_remove_file().
 *
 * Returns: 0, -EMFILE or -errno.
 */
int fetch_add_file(struct fetch *fetch, int fd, uint32_t *ret_file);
/** No request may be in flight on it. */
void fetch_remove_file(struct fetch *fetch, uint32_t file);

#define FETCH_BUFFER_NONE UINT32_MAX

/**
 * Makes memory known, which spares the kernel to pin it at each read.  Not needed for reading.
 *
 * Returns: 0, -EMFILE, -EOPNOTSUPP (the back end has no use for it) or -errno (-ENOMEM: the limit
 *	of locked memory).
 */
int fetch_add_buffer(struct fetch *fetch, void *base, uint64_t bytes, uint32_t *ret_buffer);
/** No request may be in flight into it.  FETCH_BUFFER_NONE is allowed. */
void fetch_remove_buffer(struct fetch *fetch, uint32_t buffer);

struct fetch_request {
	uint32_t file;
	uint32_t owner;       /* see fetch_has_room_for() */
	uint32_t buffer;      /* that destination lies in, or FETCH_BUFFER_NONE */
	uint64_t file_offset; /* a multiple of STORE_BLOCK_BYTES */
	uint32_t bytes;
	void *destination; /* aligned like file_offset; room for bytes rounded up to blocks */
	uint64_t tag;
};

/**
 * Begins a read; it is answered by done, never from in here.
 *
 * Returns: 0, or -EAGAIN when FILL_COUNT_MAX requests are open.
 */
int fetch_start(struct fetch *fetch, const struct fetch_request *request);

/** Hands what was started to the kernel: once a round of the loop, and after fetch_dispatch(). */
void fetch_flush(struct fetch *fetch);

/**
 * Is there room in the queue, so that the next request would be read at once (perhaps in a piece with
 * the one before), or in turn with long ones that are half begun?
 */
bool fetch_has_room(const struct fetch *fetch);

/**
 * And for one of this owner's?  Not while another of its requests waits for pieces, and not beyond
 * pieces_max in flight: what one owner asks for cannot fill the queue, however slowly it is answered.
 *
 * Cost: O(depth).
 */
bool fetch_has_room_for(const struct fetch *fetch, uint32_t owner, uint32_t pieces_max);

/** Pieces that may be read at one time. */
uint32_t fetch_depth(const struct fetch *fetch);

/** Pieces being read now. */
uint32_t fetch_in_flight(const struct fetch *fetch);

/** Bytes that the back end has read so far, whole blocks and what was read twice included. */
uint64_t fetch_read_bytes(const struct fetch *fetch);

/** Readable when fetch_dispatch() has something to do. */
int fetch_fd(const struct fetch *fetch);

/** Handles what has come back; calls done.  What can begin then goes out with fetch_flush(). */
void fetch_dispatch(struct fetch *fetch);

#endif /* DAEMON_FETCH_FETCH_H */
