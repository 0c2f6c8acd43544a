/* SPDX-License-Identifier: MIT */
/**
 * ledger.h - what a successor of the daemon must know of a store and its directory does not say: which
 * file it was, and for each node the checksum of its payload as it lies in the arena, and whether any
 * client held it.
 *
 * A private memory file: no client gets it.  It outlives the daemon with the directory and the segments
 * (handover.h).  Checksums are of what a generation's payloads are, so one that is there is right for
 * as long as the ledger is.
 *
 * Threads: loop thread.
 */
#ifndef DAEMON_CACHE_LEDGER_H
#define DAEMON_CACHE_LEDGER_H

#include <assert.h>
#include <stdatomic.h>
#include <stdint.h>

#include "daemon/arena/memfile.h"
#include "formats/base/why.h"

#define LEDGER_PATH_BYTES 1024u

/** +1 at each change of this file, of a directory's words, or of payloads in memory. */
#define LEDGER_VERSION 1u

/** What the file begins with; then a checksum a node (0: not known), then a byte a node (1: held). */
struct ledger_header {
	char magic[8];
	uint32_t version;
	uint32_t reserved;
	uint64_t device;
	uint64_t inode;
	uint64_t generation;
	uint8_t uuid[16];
	uint64_t node_count;
	uint64_t segment_bytes;
	char path[LEDGER_PATH_BYTES];
};

static_assert(sizeof(struct ledger_header) % sizeof(uint64_t) == 0, "checksums follow");

struct ledger {
	struct memfile file;
	struct ledger_header *header;
	uint64_t *checksums;
	_Atomic uint8_t *held;
};

#define LEDGER_NONE ((struct ledger){ .file = MEMFILE_NONE })

/** header: but for magic and version, which are set.  Returns: 0 or -errno. */
int ledger_create(const struct ledger_header *header, struct ledger *ret, struct why *why);

/**
 * Takes a predecessor's.
 *
 * fd:  taken over, whatever happens.
 *
 * Returns: 0, -EUCLEAN (it is none, or of another version) or -errno.
 */
int ledger_adopt(int fd, struct ledger *ret, struct why *why);

void ledger_done(struct ledger *ledger);

/**
 * Notes that somebody holds the node, before any client is granted it; or that nobody does, after all
 * grants are cleared: a daemon may end between any two stores.
 */
static inline void ledger_note_held(const struct ledger *ledger, uint32_t index, bool held)
{
	atomic_store_explicit(&ledger->held[index], held ? 1 : 0, memory_order_relaxed);
	/*
	 * Nobody else reads it while this daemon lives, so what counts is the order in which its
	 * instructions would end with it: the compiler must keep it.
	 */
	atomic_signal_fence(memory_order_seq_cst);
}

#endif /* DAEMON_CACHE_LEDGER_H */
