/* SPDX-License-Identifier: MIT */
/**
 * contest.h - one recorded walk, read through oocd and through what people would use instead.
 *
 * Each contestant is a process of its own, that waits until it is its turn: so rounds go in any
 * order, and a contestant with all that it has started can be held to a size of memory.
 *
 * A frame's nodes are all others than those of the frame before: everything is taken and given back.
 * All contestants sum up what they read; sums that differ are a failure.
 *
 * Threads: the main thread.
 */
#ifndef TOOLS_BENCH_CONTEST_CONTEST_H
#define TOOLS_BENCH_CONTEST_CONTEST_H

#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "formats/base/why.h"
#include "formats/store/layout.h"
#include "tools/bench/path/path.h"

#define CONTEST_FRAME_COUNT_MAX 4096u

/** The nodes of one frame, most important first. */
struct contest_frame {
	const uint32_t *nodes;
	size_t node_count;
};

/** What is read: the same for all. */
struct contest_walk {
	char store[PATH_MAX];
	struct store_superblock superblock;
	struct store_node *nodes;
	struct contest_frame frames[CONTEST_FRAME_COUNT_MAX];
	size_t frame_count;
	size_t read_count;       /* nodes of all frames */
	uint64_t read_bytes;     /* of all frames */
	uint64_t distinct_bytes; /* payloads that any frame has, once */
	uint64_t largest_bytes;  /* of a frame */
	uint32_t *node_memory;
};

/**
 * Selects what the cameras of a path want.
 *
 * path:         of cameras; NULL: one is made, of this kind (an orbit where there is nowhere to walk).
 * frame_count:  taken at equal distances from it.
 * budget:       triangles a frame.
 *
 * Returns: 0, -ENOTSUP (the store has a codec: nobody else could draw from it), or -errno.
 * Ownership: ends with contest_walk_done().
 */
int contest_walk_make(const char *store, const char *path, enum path_kind kind, size_t frame_count,
		      uint64_t budget, struct contest_walk *ret, struct why *why);
void contest_walk_done(struct contest_walk *walk);

/** Sums up a payload: its first and its last cache line, or every byte. */
struct contest_touch {
	bool every_byte;
	uint64_t sum;
};
void contest_touch(struct contest_touch *touch, const void *payload, size_t bytes);

/** What a contestant needs to know when it begins. */
struct contest_config {
	const struct contest_walk *walk;
	const char *scratch;   /* a folder */
	uint64_t memory_bytes; /* for its cache; 0: as much as it takes */
	uint64_t limit_bytes;  /* for all its processes and their page cache; 0: no limit */
};

/** The ways to get at a payload.  `self` is the contestant's own. */
struct contestant {
	const char *name;
	/** Returns: 0, or -ENOENT where what it needs is not installed; the reason says what. */
	int (*open)(const struct contest_config *config, void **ret_self, struct why *why);
	/** Reads a frame's nodes; `next` is the frame after it, NULL at the end. */
	int (*frame)(void *self, const struct contest_frame *frame,
		     const struct contest_frame *next, struct contest_touch *touch,
		     struct why *why);
	/** Has nothing in memory any more.  NULL: it is a floor, that has no disk behind it. */
	int (*forget)(void *self, struct why *why);
	void (*close)(void *self);
};

extern const struct contestant contestant_oocd;
extern const struct contestant contestant_mmap;
extern const struct contestant contestant_pread;
extern const struct contestant contestant_lmdb;
extern const struct contestant contestant_memcached;
/** The payloads in private memory with 2 MiB pages, their addresses in a table: the floor. */
extern const struct contestant contestant_table;
/** And with a message and an answer a frame: the floor of whoever is told what is in use. */
extern const struct contestant contestant_asked;

/** Drops a file from the page cache. */
void contest_drop_file(int fd);

struct contest_round {
	double seconds;
	uint64_t sum;
	float frame_us[CONTEST_FRAME_COUNT_MAX];
};

struct contest_seat;

/**
 * Starts a contestant and lets it open.
 *
 * Returns: 0, -ENOENT (it is not installed), -ENOTSUP (it cannot be held to limit_bytes here) or
 *	another -errno.
 * Ownership: ends with contest_leave().
 */
int contest_enter(const struct contestant *contestant, const struct contest_config *config,
		  struct contest_seat **ret, struct why *why);

/**
 * Has it read the whole walk once.
 *
 * cold:  after it has forgotten everything, which is not timed.
 * ret:   until the next call.
 *
 * Returns: 0, -ECANCELED or what the contestant said.
 */
int contest_run(struct contest_seat *seat, bool cold, bool every_byte,
		const struct contest_round **ret, struct why *why);

struct contest_seat *contest_leave(struct contest_seat *seat);

#endif /* TOOLS_BENCH_CONTEST_CONTEST_H */
