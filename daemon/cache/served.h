/* SPDX-License-Identifier: MIT */
/**
 * served.h - a store that the daemon serves: its HS and directory in shared memory, its nodes'
 * states, its arena.
 *
 * A store is identified by device and inode of the file whose descriptor was passed, never by its
 * path.  Its HS is judged when it is opened and then sealed: all later code relies on every offset
 * and count in it.  The file itself is only read, never mapped.
 *
 * served_open() blocks and belongs on a worker; the rest of the daemon sees a served store only when
 * it is whole.  What changes in it is changed by cache.c, but for the counters.
 */
#ifndef DAEMON_CACHE_SERVED_H
#define DAEMON_CACHE_SERVED_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

#include "daemon/arena/arena.h"
#include "daemon/arena/memfile.h"
#include "daemon/cache/ledger.h"
#include "daemon/cache/node.h"
#include "daemon/cache/replacement.h"
#include "daemon/counters.h"
#include "formats/base/list.h"
#include "formats/base/why.h"
#include "formats/store/layout.h"
#include "libclient/wire.h"

#define SERVED_PATH_BYTES 1024u

struct inherited;

struct served {
	struct list link; /* cache.stores */
	dev_t device;
	ino_t inode;
	char path[SERVED_PATH_BYTES]; /* for people */

	struct memfile hs; /* a store_superblock, then the records; sealed */
	const struct store_superblock *superblock;
	const struct store_node *records;
	uint32_t node_count;

	struct memfile directory_file;
	struct wire_directory *directory;
	struct node *nodes; /* node_count */

	/* For a successor of this daemon. */
	struct ledger ledger;
	uint64_t key; /* in the names of what is handed over: the same for all successors */
	struct inherited
		*inherited; /* from a predecessor, until its grace is over; of takeover.c */

	struct arena arena;
	struct list lru;       /* FREE nodes, the one unused for the longest first */
	uint64_t pinned_pages; /* of BUSY and HELD nodes */
	uint64_t held_pages;   /* of HELD ones */
	uint64_t ready_count;  /* of HELD and FREE nodes */
	bool segment_coming;   /* being made by a worker */
	/* No window of so many pages was found when the cache had released so much; 0: none such. */
	uint32_t full_pages;
	uint64_t full_at_bytes;

	int fd;
	bool direct;   /* O_DIRECT */
	uint32_t file; /* of the fetch layer */
	uint32_t attach_count;
	bool keep;                       /* named on the command line: never closed */
	uint64_t idle_since_ns;          /* attach_count is 0 since */
	uint32_t logged_count;           /* lines about its nodes; bounded */
	struct store_counters counters;  /* since it was opened */
	struct replacement *replacement; /* order of the FREE nodes; NULL: that of the lru list */
	bool has_evicted;                /* before that, replacement is told nothing */
	struct recorded *recorded;       /* in the trace; NULL: none is written (recorder.h) */
	/* Nodes that an administrator wants resident; see residents.h. */
	uint32_t resident_count;
	uint32_t resident_wanted_count; /* of them without a hold yet */
	uint64_t resident_pages;
	uint32_t resident_next; /* no ABSENT one that is wanted lies before it */
};

/**
 * Which store a descriptor is of.
 *
 * Returns: 0, -EINVAL (not a regular file), -EACCES (not open for reading) or -errno.
 */
int served_identify(int fd, dev_t *ret_device, ino_t *ret_inode, struct why *why);

/**
 * Is the file still the generation that is served?  It may have been written anew in its place.
 *
 * Threads: any.  May block.
 */
bool served_is_current(int fd, const uint8_t uuid[16], uint64_t generation);

/**
 * Opens a store whose descriptor passed served_identify().
 *
 * fd:           taken over, whatever happens.
 * cache_bytes:  the budget of all stores, which bounds the size of segments.
 * epoch:        of this daemon.
 *
 * Returns: 0, -EUCLEAN, -EBADMSG, -ENODATA, -EINVAL, -EPROTONOSUPPORT (see store_open()), -ENOBUFS
 *	(the cache cannot hold its largest payload), -ENOMEM or -errno.
 * Threads: any.  May block.
 */
int served_open(int fd, const char *path, uint64_t cache_bytes, uint64_t epoch, struct served **ret,
		struct why *why);

/**
 * How large the segments of such a store are, in a cache of that size.
 *
 * superblock:  its payload_bytes_max, payload_raw_bytes and node_count.
 *
 * Returns: 0, or -ENOBUFS (the cache cannot hold its largest payload).
 */
int served_segment_bytes(const struct store_superblock *superblock, uint64_t cache_bytes,
			 uint64_t *ret, struct why *why);

/** Nothing of it may be in flight.  NULL is allowed.  Returns: NULL. */
struct served *served_close(struct served *served);

/**
 * Makes a store that was just opened the heir of a predecessor's: its ledger, and segments as long as
 * they were.
 *
 * ledger:  taken over on success, and emptied.
 *
 * Returns: 0, -ESTALE (the file is another generation, or another file), -ENOBUFS (the cache cannot
 *	hold one of its segments).
 */
int served_inherit(struct served *served, struct ledger *ledger, uint64_t key, uint64_t cache_bytes,
		   struct why *why);

/** Has the node a payload? */
static inline bool served_has_payload(const struct served *served, uint32_t index)
{
	return index < served->node_count && served->nodes[index].page_count > 0;
}

/** Pages of the node's payload in the arena. */
static inline uint32_t served_pages(const struct served *served, uint32_t index)
{
	return served->nodes[index].page_count;
}

#endif /* DAEMON_CACHE_SERVED_H */
